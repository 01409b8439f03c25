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

from qlvbayes.diagnosis.prior import Families
from qlvbayes.diagnosis.search import Search
from qlvbayes.diagnosis.searchsetup import build_search
from qlvbayes.diagnosis.settings import Breadth, DiagnosisSettings
from qlvbayes.effects.catalogue import OUTSIDE, find
from qlvbayes.effects.effect import AbstractEffect, Level
from qlvbayes.inference.forward.hypothesis import Hypothesis
from qlvbayes.io.data import Pad, Test
from qlvbayes.io.units import PAD
from qlvbayes.model.choices import Choices
from qlvbayes.motion.experiment import prepare
from qlvbayes.priors import LogNormal, Normal
from qlvbayes.simulate import HIDDEN, HiddenPad, encode, thin

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


Shifted = type(
    "Shifted",
    (Scaled,),
    {"name": "shifted", "default": classmethod(lambda cls, scales: cls(Normal(1.0, 0.1)))},
)


@pytest.mark.parametrize("kind", [Scaled, Shifted])
@pytest.mark.slow
def test_a_users_effect_is_tried_whatever_its_prior_and_its_null(kind, experiment):
    """A factor of all forces is the stiffness once more: the best fit is the plain model's."""
    search = build_search(experiment, kinds=(kind,))
    search.evaluate(BASELINE)
    plain = search.modes[BASELINE][0]
    search.evaluate(BASELINE.plus(kind.name))
    found = search.modes[BASELINE.plus(kind.name)][0]
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
