r"""Coverage of the intervals of an effect's constants in simulated tests.

A pad and its effect are drawn from their priors, its forces are computed by the law, and noise of
known size is added. The interval between two quantiles of a constant's posterior then holds the
truth with just the probability between them, also for amplitudes near zero and for shapes that the
tests leave open (Talts et al. 2018, arXiv:1804.06788).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from qlvbayes.effects.catalogue import EFFECTS
from qlvbayes.effects.effect import AbstractEffect
from qlvbayes.io.checks import InputError
from recovery.bench import SHOWING, bench
from recovery.pads import Pads

LEVEL = 0.9
"""Posterior probability of an interval."""

_ENDS = (0.5 - 0.5 * LEVEL, 0.5 + 0.5 * LEVEL)


@dataclass(frozen=True, eq=False)
class Recovery:
    """An effect's free constants, the truth of each in every draw, and its 90 % interval.

    truth, low, high: (draws, constants), in the constants' own units (mm, N, s); worth: (draws,)
    effective posterior draws behind the intervals.
    """

    effect: str
    constants: tuple[str, ...]
    truth: np.ndarray
    low: np.ndarray
    high: np.ndarray
    worth: np.ndarray

    @property
    def inside(self) -> np.ndarray:
        """(draws, constants) whether the interval holds the truth."""
        return (self.low <= self.truth) & (self.truth <= self.high)

    @property
    def rate(self) -> float:
        """Share of all intervals that hold the truth: 0.9 but for chance."""
        return float(self.inside.mean())


def recovery_rate(kind: type[AbstractEffect], *, draws: int = 20, seed: int = 0) -> Recovery:
    r"""Simulate an effect ``draws`` times, fit it, and see which 90 % intervals hold the truth.

    The pad, its effect (``kind.default``) and its noise are drawn from their priors. The fit knows
    the noise's sds and time, as a floor that was measured without the model, so that

    .. math:: P(q_{0.05}(y) \le \theta \le q_{0.95}(y)) = 0.9

    for each constant (Talts et al. 2018, arXiv:1804.06788). Two tests load the pad to 1.6 mm at 1
    and 10 mm/s, hold it for 10 s, and unload it by half and fully. The law that is fitted is the
    one that was simulated: this tests the inference, not the law. The intervals come from
    importance sampling about the posterior's modes, which need not be normal. The pad lies loose,
    but for an effect that only a specimen shows which is held by its faces.

    Parameters
    ----------
    kind
        The effect's class.
    draws
        How many pads.
    seed
        Of all that is drawn.

    Raises
    ------
    InputError
        The tests cannot show the effect (``kind.blind``), or ``draws`` is not positive.
    """
    return recovery_rates((kind,), draws=draws, seed=seed)[0]


def recovery_rates(
    kinds: Sequence[type[AbstractEffect]] = EFFECTS, *, draws: int = 20, seed: int = 0
) -> list[Recovery]:
    """Return `recovery_rate` of several effects, each alone on its pad, compiled once."""
    if draws < 1:
        raise InputError(f"{draws} draws", remedy="use one or more")
    bonded = {kind: kind.unmeasured(SHOWING) is not None for kind in kinds}
    for kind in kinds:
        if reason := kind.blind(replace(SHOWING, bonded=bonded[kind])):
            raise InputError(f"the tests cannot show {kind.name}: {reason}")
    spaces = {}
    for held in set(bonded.values()):
        effects = [kind.default(bench().scales) for kind in kinds if bonded[kind] == held]
        spaces[held] = bench().space(effects, bonded=held)
    return [_recovery(Pads(kind.name, spaces[bonded[kind]]), draws, seed) for kind in kinds]


def _recovery(pads: Pads, draws: int, seed: int) -> Recovery:
    trials = [pads.recovered(seed, k, _ENDS) for k in range(draws)]
    truth, ends, worth = (np.array(column) for column in zip(*trials, strict=True))
    return Recovery(pads.effect, tuple(pads.constants), truth, ends[:, 0], ends[:, 1], worth)
