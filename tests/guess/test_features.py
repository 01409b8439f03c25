"""Features of a first guess obey the algebra of normal densities; look prints the guess."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm
from support.endtoend import call, with_tests
from support.hidden_pads import hidden_pad

from qlvbayes.guess.features import COMMON, OWN, Expansion, features_of
from qlvbayes.guess.guess import guessed, weights
from qlvbayes.guess.responses import responses_of
from qlvbayes.io.data import Pad
from qlvbayes.io.units import PAD
from qlvbayes.motion.experiment import prepare
from qlvbayes.motion.phases import KINDS
from qlvbayes.simulate import HIDDEN

DRAGS = {"viscous_drag", "power_law_drag", "squeeze_film"}


def expansion(signed):
    rng = np.random.default_rng(3)
    root = rng.normal(size=(2, 5, 3))
    curvatures = np.einsum("snk,snl->skl", root, root)
    losses = np.array([0.3, -0.4])
    return Expansion(losses, rng.normal(size=(2, 3)) * 2.0, curvatures, np.array(signed))


@pytest.mark.parametrize("signed", [True, False])
def test_the_evidence_of_an_amplitude_is_the_integral_over_its_prior(signed):
    one = expansion([signed] * 3)
    for k in range(3):
        total = 0.0
        for loss, g, h in zip(
            one.losses, one.gradients[:, k], one.curvatures[:, k, k], strict=True
        ):

            def weighted(a, g=g, h=h):
                return norm.pdf(a) * (1.0 if signed else 2.0) * np.exp(a * g - 0.5 * a * h * a)

            total += np.exp(-loss) * quad(weighted, -30.0 if signed else 0.0, 30.0)[0]
        expected = np.log(total / np.exp(-one.losses).sum())
        assert one.evidence[k] == pytest.approx(expected, abs=1e-6)


def test_one_amplitude_after_another_is_both_at_once():
    one = expansion([True, True, True])
    pair = one.given(0).evidence[2] + one.evidence[0]
    both = [0, 2]
    total = 0.0
    for loss, g, h in zip(one.losses, one.gradients, one.curvatures, strict=True):
        g, h = g[both], np.eye(2) + h[np.ix_(both, both)]
        total += np.exp(0.5 * g @ np.linalg.solve(h, g) - loss) / np.sqrt(np.linalg.det(h))
    assert pair == pytest.approx(np.log(total / np.exp(-one.losses).sum()), abs=1e-9)


@pytest.fixture(scope="module")
def dragged():
    """A pad with a drag of a tenth of its peak force, at three speeds."""
    return hidden_pad(HIDDEN["viscous_drag"](0.008), rates=(1.0, 10.0, 100.0))


@pytest.fixture(scope="module")
def responses(dragged):
    return responses_of(dragged)


def test_a_strong_drag_is_guessed_first(dragged, responses):
    features = features_of(responses)
    assert features.rows.shape == (len(features.effects), len(OWN) + len(COMMON))
    assert np.isfinite(features.rows).all()
    evidence = dict(zip(features.effects, features.own[:, 0], strict=True))
    assert max(evidence, key=evidence.get) in DRAGS
    guess = guessed(dragged.pad, features, weights())
    assert next(iter(guess.effects)) in DRAGS
    assert guess.nothing.probability < 0.5 * next(iter(guess.effects.values())).probability
    assert "`qlvbayes diagnose` decides" in guess.sentence


def test_what_is_gained_in_phases_adds_up(responses):
    features = features_of(responses)
    first = OWN.index(f"gain_{KINDS[0]}")
    shares = np.abs(features.own[:, first : first + len(KINDS)]).sum(axis=1)
    assert np.all((shares < 1e-9) | (np.abs(shares - 1.0) < 1e-9))


def test_the_unit_of_force_does_not_matter(dragged, responses):
    thousand = [replace(one.test, force=1000.0 * one.test.force) for one in dragged.trials]
    scaled = responses_of(prepare(Pad("B", tuple(thousand), PAD)))
    one, other = (features_of(r) for r in (responses, scaled))
    assert one.effects == other.effects
    assert scaled.peak == pytest.approx(1000.0 * responses.peak)
    noise = OWN.index("amplitude")  # of an effect that is not there: where the search ended
    rows = [np.delete(some.rows, noise, axis=1) for some in (one, other)]
    assert np.allclose(*rows, atol=0.02)
    guesses = [guessed("B", some, weights()) for some in (one, other)]
    assert guesses[0].sentence == guesses[1].sentence


def test_a_record_unlike_those_learnt_from_gets_no_guess(dragged, responses):
    features = features_of(responses)
    for name in ("noise", "misfit", "tests"):
        common, k = features.common.copy(), COMMON.index(name)
        common[k] += 12.0 * weights().sd[len(OWN) + k]
        guess = guessed("B", replace(features, common=common), weights())
        assert not guess.effects
        assert guess.nothing is None
        assert guess.sentence.startswith("No first guess")
        assert "_" not in guess.sentence


def test_a_guess_is_printed_next_to_json(tmp_path):
    data = with_tests(tmp_path / "some.csv", "B-1", "B-20")
    status, out, err = call("look", data, "--pad", "B", "--cause", "--json")
    assert status == 0
    assert [pad["pad"] for pad in json.loads(out)["pads"]] == ["B"]
    (line,) = (line for line in err.splitlines() if line.startswith("pad B: "))
    assert line.startswith("pad B: First guess from one fit: ")
    assert line.endswith("`qlvbayes diagnose` decides.")
