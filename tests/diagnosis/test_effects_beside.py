"""Check effects of no size added to a model, and one that is hidden."""

import numpy as np
import pytest
from support.hidden_pads import hidden_pad

from qlvbayes.diagnosis.diagnose import run_search
from qlvbayes.diagnosis.searchsetup import build_search
from qlvbayes.effects.catalogue import EFFECTS, FORMS, find
from qlvbayes.effects.contacts import InterfaceSlip
from qlvbayes.inference.evidence import evidence
from qlvbayes.inference.forward.hypothesis import Hypothesis
from qlvbayes.inference.starts import amplitude_of, shapes
from qlvbayes.priors import HalfNormal
from qlvbayes.simulate import HIDDEN, full_retraction_protocol

BASELINE = Hypothesis("exponential", "prony:2")
RATES = (1.0, 20.0, 100.0)


LOOSE = [kind for kind in (*EFFECTS, *FORMS) if kind is not InterfaceSlip]
"""What may be missing of a specimen that is pressed; one that is held may slip."""


@pytest.fixture(scope="module")
def plain():
    """A search over all effects that knows the plain model's mode, of tests that lose contact."""
    search = build_search(hidden_pad(rates=RATES, protocol=full_retraction_protocol))
    search.begin()
    return search


@pytest.mark.parametrize("kind", LOOSE, ids=lambda kind: kind.name)
@pytest.mark.few(5)
def test_an_effect_at_nothing_is_the_plain_model(plain, kind):
    """It is also above zero displacement; effects that refine the grid are 1e-5 off at most."""
    point, space = plain.modes[BASELINE][0].point, plain.density.space
    assert np.asarray(space.record.motion.displacement)[:, 0].max() > 0.0
    hypothesis = BASELINE.plus(kind.name)
    own = space.parameters(hypothesis)
    start = shapes(space, point, own, kind.name)[-1]
    found = space.forces(hypothesis, own.constants(start[None]))[0]
    close = (1e-5 if kind.costly else 1e-9) * np.abs(point.predicted).max()
    np.testing.assert_allclose(found, point.predicted, rtol=0.0, atol=close)


@pytest.mark.parametrize("share", [1e-3, 1.0])
@pytest.mark.parametrize("kind", LOOSE, ids=lambda kind: kind.name)
@pytest.mark.few(5)
def test_no_evidence_is_above_the_likelihood_of_an_exact_fit(plain, kind, share):
    """Z_s = int L_s pi <= max L_s, at every size; also where constants are next to nothing."""
    density, point = plain.density, plain.modes[BASELINE][0].point
    hypothesis = BASELINE.plus(kind.name)
    own = density.space.parameters(hypothesis)
    start = shapes(density.space, point, own, kind.name)[0]
    amplitude = amplitude_of(own, kind.name)
    start[amplitude.number] = 0.5 * amplitude.sd
    halves = [leaf.theta.start for leaf in own.leaves if isinstance(leaf.prior, HalfNormal)]
    halves = [number for number in halves if number not in own.amplitudes]
    start[halves] *= share
    place = density.at(hypothesis, start)
    sizes = density.discrepancy.sizes.tolist()
    highest = np.array(
        [-0.5 * density.discrepancy.at(size, place.separation).log_volume for size in sizes]
    )
    found = evidence(density, place).by_size - density.discrepancy.log_prior
    assert np.all(found <= highest)


@pytest.mark.slow
def test_hidden_adhesion_is_found():
    """It is found although the gap it leaves could be taken for an offset of the force."""
    hidden = HIDDEN["adhesion"](strength=0.03)
    kinds = tuple(map(find, ("adhesion", "force_offset", "contact_offset")))
    search = build_search(
        hidden_pad(hidden, rates=RATES, protocol=full_retraction_protocol), kinds=kinds
    )
    run_search(search)
    assert "adhesion" in search.best.effects
    point = search.candidates[search.best].point
    strength = point.constants[point.own.names.index("adhesion.strength")]
    assert strength == pytest.approx(0.03, rel=0.2)
