"""The best tests for the time there is: screened, the best few judged, then one after another."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from qlvbayes.checks import InputError
from qlvbayes.nexttest.belief import Belief
from qlvbayes.nexttest.design import LEAST_WAIT, Design, drawn
from qlvbayes.nexttest.errors import Errors
from qlvbayes.nexttest.information import Products, evidence
from qlvbayes.nexttest.judging import Judged, judged
from qlvbayes.nexttest.rig import Rig
from qlvbayes.nexttest.screening import screened

Array = NDArray[np.float64]

SCREENED = 1024
"""Designs that are drawn."""
BEST = 5
"""Of these, that are judged without taking forces for linear."""
MOST = 5
"""Tests in a series."""


@dataclass(frozen=True)
class Wish:
    """What the tests are for: names of constants, and whether for the cause."""

    constants: tuple[str, ...]
    cause: bool

    def total(self, constants: Array, cause: Array) -> Array:
        """Bits of what is wished for."""
        return (constants if self.constants else 0.0) + (cause if self.cause else 0.0 * cause)


@dataclass(frozen=True, eq=False)
class Option:
    """A test and what it would tell.

    constants, cause, cause_most: bits in closed form, beyond what the series before it tells (the
    bound from below and from above); evidence: expected 2 ln Bayes factor between the two nearest
    explanations; judged: by nested Monte Carlo, of this test alone.
    """

    design: Design
    constants: float
    cause: float
    cause_most: float
    evidence: float
    judged: Judged | None = None


@dataclass(frozen=True, eq=False)
class Series:
    """What was planned.

    tests: the next ones, in order; options: the best for the first place, the best first; screened:
    how many designs fitted; judged: all tests together; now, after: products of no test and of all.
    """

    tests: tuple[Option, ...]
    options: tuple[Option, ...]
    screened: int
    judged: Judged | None
    now: Products
    after: Products

    @property
    def minutes(self) -> float:
        """Of rig time."""
        return sum(one.design.minutes for one in self.tests)


def bits_for_constants(belief: Belief, products: Products, names: Sequence[str]) -> Array:
    """(T,) averaged over the explanations by their probability."""
    total = np.zeros(len(products.values))
    for k, one in enumerate(belief.explanations):
        total += one.probability * products.bits_for(k, one.asked(names))
    return total


def planned_series(
    belief: Belief,
    rig: Rig,
    errors: Errors,
    wish: Wish,
    *,
    minutes: float,
    tests: int,
    clock: float = 0.0,
    seed: int = 0,
    count: int = SCREENED,
    best: int = BEST,
    tell: Callable[[str], None] = lambda text: None,
) -> Series:
    """Tests that tell most per minute of rig time, in at most ``minutes`` together.

    The first is the best of those judged; the others are added one by one by the closed form, what
    the ones before them tell being known. Raises InputError where no test fits into the time.
    """
    tell(f"screening {count} tests")
    designs = drawn(rig, belief.recovery, 60.0 * minutes, count, seed)
    if not designs:
        raise _no_time(belief, minutes)
    products, sound = screened(belief, designs, rig, errors, clock)
    none = Products.none(products.sizes)
    if not sound.any():
        raise InputError("no test has a finite force", remedy="give lower limits of the rig")

    def judge(some: Sequence[Option]) -> Judged | None:
        if best == 0:
            return None
        own = [one.design for one in some]
        return judged(belief, own, rig, errors, wish.constants, clock=clock, seed=seed)

    options = _options(belief, designs, products, wish, none)
    first = [options[k] for k in _by_rate(options, wish, sound)[: max(best, 1)]]
    tell(f"judging the best {len(first)}")
    first = [replace(one, judged=judge([one])) for one in first]
    first.sort(key=lambda one: -rate(one, wish))
    chosen, told = [first[0]], none + products[np.array([designs.index(first[0].design)])]
    while len(chosen) < min(tests, MOST):
        left = minutes - sum(one.design.minutes for one in chosen)
        pause = belief.recovery.time(chosen[-1].design.duration)
        waiting = [replace(one, wait=max(one.wait, pause)) for one in designs]
        more = _options(belief, waiting, products, wish, told)
        fits = sound & np.array([one.design.minutes <= left for one in more])
        if not fits.any():
            break
        k = int(_by_rate(more, wish, fits)[0])
        chosen.append(more[k])
        told = told + products[np.array([k])]
    tell("judging them together")
    return Series(tuple(chosen), tuple(first), int(sound.sum()), judge(chosen), none, told)


def _no_time(belief: Belief, minutes: float) -> InputError:
    least = max(belief.recovery.time(1.0), LEAST_WAIT)
    return InputError(
        f"no test fits into {minutes:g} minutes: the pause before one takes {least:.0f} s or more",
        remedy="give more --minutes",
    )


def rate(one: Option, wish: Wish) -> float:
    """Bits per minute of what is wished for, judged where that was done."""
    bits = float(wish.total(np.array(one.constants), np.array(one.cause)))
    if one.judged is not None:
        found = float(wish.total(np.array(one.judged.constants), np.array(one.judged.cause)))
        bits = found if np.isfinite(found) else bits
    return bits / one.design.minutes


def _options(
    belief: Belief, designs: Sequence[Design], products: Products, wish: Wish, told: Products
) -> list[Option]:
    """Every design, after the tests of which the products are ``told`` (1,)."""
    p = belief.probabilities
    after = products + told
    constants = bits_for_constants(belief, after, wish.constants)
    constants -= bits_for_constants(belief, told, wish.constants)
    low, high = (
        np.maximum(new - old, 0.0)
        for new, old in zip(after.bits_for_cause(p), told.bits_for_cause(p), strict=True)
    )
    columns = (constants, low, high, evidence(after))
    rows = zip(designs, *(column.tolist() for column in columns), strict=True)
    return [Option(*row) for row in rows]


def _by_rate(options: Sequence[Option], wish: Wish, allowed: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Places of the options, the best first; those not allowed come last."""
    rates = np.array([rate(one, wish) for one in options])
    return np.argsort(np.where(allowed, -rates, np.inf), kind="stable")
