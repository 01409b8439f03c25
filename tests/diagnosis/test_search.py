"""The search over hypotheses against pads whose law and hidden effect are known."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest
from blind.laws import Law
from blind.loadcell import LoadCell
from blind.programmes import session
from support.hidden_pads import FEW, hidden_pad

from qlvbayes.diagnosis.diagnose import run_search
from qlvbayes.diagnosis.prior import Families
from qlvbayes.diagnosis.search import Search
from qlvbayes.diagnosis.searchsetup import build_search
from qlvbayes.diagnosis.settings import Breadth, DiagnosisSettings
from qlvbayes.effects.catalogue import EFFECTS, FORMS, OUTSIDE, find
from qlvbayes.effects.contacts import InterfaceSlip
from qlvbayes.effects.effect import AbstractEffect, Level
from qlvbayes.inference.evidence import evidence
from qlvbayes.inference.forward.hypothesis import Hypothesis
from qlvbayes.inference.starts import shapes
from qlvbayes.io.data import Pad, Test
from qlvbayes.io.units import PAD
from qlvbayes.model.choices import Choices
from qlvbayes.motion.experiment import prepare
from qlvbayes.priors import HalfNormal, LogNormal
from qlvbayes.simulate import HIDDEN, HiddenPad, encode, full_retraction_protocol, thin

RATES = (0.1, 1.0)
BASELINE = Hypothesis("exponential", "prony:2")


def tabled(table):
    """A search that has seen hypotheses of these log posteriors, which leave only noise."""
    noise = SimpleNamespace(mode=SimpleNamespace(size=0.0))

    class Tabled(Search):
        def log_posterior(self, hypothesis):
            return table[hypothesis]

    return Tabled(
        None, DiagnosisSettings(), BASELINE, Families({}), modes={key: [noise] for key in table}
    )


@pytest.fixture(scope="module")
def experiment():
    """Two tests of a pad with nothing hidden."""
    return hidden_pad(rates=RATES)


def test_a_form_put_into_the_model_takes_the_place_of_its_family(experiment):
    search = build_search(experiment, Choices(effects=("pressure_friction",)), kinds=FEW)
    effects = set(search.density.space.effects)
    drift = {"force_drift", "levelling_drift"}
    listed = {"viscous_drag", "guide_drag", "pressure_friction", "force_offset", *drift}
    assert effects == listed | {kind.name for kind in OUTSIDE}


def test_the_likeliest_that_come_near_are_expanded():
    drag, both = BASELINE.plus("viscous_drag"), BASELINE.plus("viscous_drag").plus("inertia")
    near, far = replace(drag, elastic="hertz"), replace(drag, elastic="linear")
    search = tabled({drag: -100.0, both: -101.0, near: -104.0, BASELINE: -106.0, far: -500.0})
    assert search.beam == [drag, both]
    search.settings = DiagnosisSettings(breadth=Breadth(beam=9))
    assert search.beam == [drag, both, near, BASELINE]


def test_neighbours_are_one_law_or_one_effect_away(experiment):
    drag, best = build_search(experiment, kinds=FEW), BASELINE.plus("viscous_drag")
    drag.modes[best] = [SimpleNamespace(mode=SimpleNamespace(size=0.0))]
    some = drag.neighbours(best)
    assert best not in some
    for one in some:
        apart = (one.elastic != best.elastic) + (one.relaxation != best.relaxation)
        assert apart + len(one.effects ^ best.effects) == 1
    listed = set(drag.families.nameable)
    assert {next(iter(h.effects - best.effects)) for h in some if h.effects > best.effects} == (
        listed - best.effects
    )
    forms = {name for one in drag.forms(best) for name in one.effects - best.effects}
    assert forms == set(drag.families.members("viscous_drag")) - {"viscous_drag"}
    more = {name for one in drag.with_unlisted(best) for name in one.effects - best.effects}
    assert more | forms == set(drag.families.family_of) - listed


def test_effects_are_replaced_by_those_that_explained_most_elsewhere():
    """Friction came first, and neither thixotropy nor drift is worth adding to it."""
    friction, thixotropy = BASELINE.plus("friction"), BASELINE.plus("thixotropy")
    known = {BASELINE: -200.0, friction: -150.0, thixotropy: -160.0}
    known |= {BASELINE.plus("inertia"): -199.0, friction.plus("force_drift"): -149.0}
    search = tabled(known)
    names = ("friction", "thixotropy", "inertia", "force_drift")
    search.families = Families({name: name for name in names})
    search.settings = DiagnosisSettings(breadth=Breadth(substitutes=1))
    assert search.substitutions(friction.plus("force_drift")) == [
        BASELINE.plus("thixotropy").plus("friction"),
        BASELINE.plus("thixotropy").plus("force_drift"),
    ]


class Scaled(AbstractEffect):
    """F times a factor that is 1 where nothing is there: null is not 0, the prior not normal."""

    factor: Any
    name: ClassVar[str] = "scaled"
    level: ClassVar[Level] = Level.SCALING
    rank: ClassVar[int] = 9
    units: ClassVar[dict[str, str]] = {"factor": "count"}
    null: ClassVar[dict[str, float]] = {"factor": 1.0}
    law: ClassVar[str] = "F -> factor F"
    seen: ClassVar[str] = "all of it larger or smaller"
    reference: ClassVar[str] = "none"

    @classmethod
    def default(cls, scales):
        return cls(LogNormal(0.0, 0.1))

    def force(self, below, motion):
        return self.factor * below.force(motion)


@pytest.mark.slow
def test_a_users_effect_is_tried_whatever_its_prior_and_its_null(experiment):
    """A factor of all forces is the stiffness once more: the best fit is the plain model's."""
    search = build_search(experiment, kinds=(Scaled,))
    search.evaluate(BASELINE)
    plain = search.modes[BASELINE][0]
    search.evaluate(BASELINE.plus("scaled"))
    found = search.modes[BASELINE.plus("scaled")][0]
    assert found.mode.converged
    assert found.point.residual @ found.point.residual == pytest.approx(
        plain.point.residual @ plain.point.residual, rel=0.02
    )


def sines(*effects):
    """Sines of 0.1 to 3 Hz, thinned to 400 readings a test, an encoder of 1 um, noisy."""
    rng, cell = np.random.default_rng(0), LoadCell(white=0.004, correlated=0.0055, time=0.5)
    law = Law("exponential", (0.5, 0.8), "prony:2", (0.3, 6.2, 0.2, 0.15))
    material = HiddenPad(law, effects, cells=12, frame_speed=True)
    tests = []
    for name, motion in session("sine", False, 30.0, 0.0, rng).motions.items():
        every = np.arange(int(motion.duration * 1000.0)) / 1000.0
        time = every[thin(every, encode(motion.displacement(every)), 400)]
        read = cell.position(motion.displacement(time))
        force = material.force(motion, time) + cell.draw(time, rng)
        start = {"start_s": motion.start_s, "start_known": True}
        tests.append(Test(name, name, time, read, force, **start))
    return prepare(Pad("pad", tuple(tests), PAD))


@pytest.mark.slow
def test_the_mode_is_found_where_a_discrepancy_could_stand_for_the_effect():
    search = build_search(sines(HIDDEN["friction"](strength=0.09, reach=0.035)))
    search.begin()
    plain, more = search.candidates[BASELINE], BASELINE.plus("friction")
    assert plain.mode.size > 0.0
    search.evaluate(more)
    best = search.candidates[more].mode
    place = best.point.own.names.index("friction.strength")
    assert best.point.constants[place] == pytest.approx(0.09, rel=0.1)
    assert best.loss < plain.mode.loss - 100.0


def test_an_effect_that_the_record_shows_is_added_in_each_of_its_forms():
    search = tabled({BASELINE: -100.0})
    search.families = Families.from_kinds([find("viscous_drag"), find("guide_drag")])
    assert search._lacks(BASELINE) == set()
    search.measured = frozenset({"viscous_drag", "inertia"})  # these tests cannot show the latter
    assert search._lacks(BASELINE) == {"viscous_drag"}
    assert search._lacks(BASELINE.plus("guide_drag")) == set()
    forms = {name for one in search.forms(BASELINE, {"viscous_drag"}) for name in one.effects}
    assert forms == {"viscous_drag", "guide_drag"}


LOOSE = [kind for kind in (*EFFECTS, *FORMS) if kind is not InterfaceSlip]
"""What may be missing of a specimen that is pressed; one that is held may slip."""
RETRACTED = (1.0, 20.0, 100.0)  # mm/s


@pytest.fixture(scope="module")
def plain():
    """A search over all effects that knows the plain model's mode, of tests that lose contact."""
    search = build_search(hidden_pad(rates=RETRACTED, protocol=full_retraction_protocol))
    search.begin()
    return search


@pytest.mark.parametrize("kind", LOOSE, ids=lambda kind: kind.name)
@pytest.mark.few(5)
def test_an_effect_at_nothing_is_the_plain_model_and_none_beats_an_exact_fit(plain, kind):
    """Effects that refine the grid are 1e-5 off at most, also above zero displacement.

    Z_s = int L_s pi <= max L_s, at every size; also where constants are next to nothing.
    """
    density, point = plain.density, plain.modes[BASELINE][0].point
    space, hypothesis = density.space, BASELINE.plus(kind.name)
    assert np.asarray(space.record.motion.displacement)[:, 0].max() > 0.0
    own = space.parameters(hypothesis)
    starts = shapes(space, point, own, kind.name)
    first, last = starts[0].copy(), starts[-1]
    found = space.forces(hypothesis, own.constants(last[None]))[0]
    close = (1e-5 if kind.costly else 1e-9) * np.abs(point.predicted).max()
    np.testing.assert_allclose(found, point.predicted, rtol=0.0, atol=close)
    amplitude = own.amplitude_of[kind.name]
    first[amplitude.number] = 0.5 * amplitude.sd
    halves = [leaf.theta.start for leaf in own.leaves if isinstance(leaf.prior, HalfNormal)]
    halves = [number for number in halves if number not in own.amplitudes]
    sizes = density.discrepancy.sizes.tolist()
    for share in (1.0, 1e-3):
        start = first.copy()
        start[halves] *= share
        place = density.at(hypothesis, start)
        volumes = [density.discrepancy.at(x, place.separation).log_volume for x in sizes]
        by_size = evidence(density, place).by_size - density.discrepancy.log_prior
        assert np.all(by_size <= -0.5 * np.array(volumes))


@pytest.mark.slow
def test_hidden_adhesion_is_found():
    """It is found although the gap it leaves could be taken for an offset of the force."""
    hidden = HIDDEN["adhesion"](strength=0.03)
    kinds = tuple(map(find, ("adhesion", "force_offset", "contact_offset")))
    search = build_search(
        hidden_pad(hidden, rates=RETRACTED, protocol=full_retraction_protocol), kinds=kinds
    )
    run_search(search)
    assert "adhesion" in search.best.effects
    point = search.candidates[search.best].point
    strength = point.constants[point.own.names.index("adhesion.strength")]
    assert strength == pytest.approx(0.03, rel=0.2)
