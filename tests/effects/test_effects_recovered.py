"""Simulated with an effect and fitted with it, its 90 % intervals hold the truth at that rate."""

import math
from dataclasses import replace

import numpy as np
import pytest
from recovery import recovery_rate
from recovery.rate import LEVEL, recovery_rates
from scipy.stats import binom

from qlvbayes import InputError
from qlvbayes.effects.catalogue import EFFECTS
from qlvbayes.effects.contacts import Adhesion

DRAWS = 4
ERRORS = 3.0  # binomial standard errors of the overall rate
CHANCE = 2.0 * 0.00135  # the same, as a probability


@pytest.fixture(scope="module")
def recovered():
    """Each effect; those that run the law several times have a model of their own."""
    light = [kind for kind in EFFECTS if not kind.costly]
    costly = [kind for kind in EFFECTS if kind.costly]
    return [found for some in (light, costly) for found in recovery_rates(some, draws=DRAWS)]


def off(recovered):
    """Return whether all intervals together hold the truth too often or too seldom."""
    inside = np.concatenate([found.inside.ravel() for found in recovered])
    error = math.sqrt(LEVEL * (1.0 - LEVEL) / inside.size)
    return bool(abs(inside.mean() - LEVEL) > ERRORS * error)


def below_chance(recovered):
    """Effects of which a constant is held more seldom than chance allows (Sidak)."""
    constants = sum(len(found.constants) for found in recovered)
    least = 1.0 - (1.0 - CHANCE) ** (1.0 / constants)
    return [
        found.effect
        for found in recovered
        if binom.cdf(found.inside.sum(axis=0), len(found.inside), LEVEL).min() < least
    ]


def scaled(found, factor):
    """The same with intervals of another width about the same middle."""
    middle, half = 0.5 * (found.low + found.high), 0.5 * factor * (found.high - found.low)
    return replace(found, low=middle - half, high=middle + half)


@pytest.mark.slow
def test_every_effect_is_recovered_at_the_right_rate_and_wrong_intervals_are_noticed(recovered):
    assert {found.effect for found in recovered} == {kind.name for kind in EFFECTS}
    assert not off(recovered)
    assert not below_chance(recovered)
    assert min(found.worth.min() for found in recovered) > 50.0
    assert off([scaled(found, 0.5) for found in recovered])
    wrong = [scaled(recovered[0], 0.0), *recovered[1:]]
    assert below_chance(wrong) == [recovered[0].effect]


def test_what_the_tests_cannot_show_is_refused():
    class Hidden(Adhesion):
        """Seen by no test."""

        @classmethod
        def blind(cls, protocol):
            return "nobody looks"

    with pytest.raises(InputError, match="cannot show adhesion: nobody looks"):
        recovery_rate(Hidden)
    with pytest.raises(InputError, match="0 draws"):
        recovery_rate(Adhesion, draws=0)
