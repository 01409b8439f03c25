"""The best tests for the time there is: screened, the best few judged, then one after another."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from qlvbayes.diagnosis.nexttest.belief import Belief
from qlvbayes.diagnosis.nexttest.design import LEAST_WAIT, Design, drawn
from qlvbayes.diagnosis.nexttest.errors import Errors
from qlvbayes.diagnosis.nexttest.information import Products, evidence
from qlvbayes.diagnosis.nexttest.montecarlo import Judged, judged
from qlvbayes.diagnosis.nexttest.rig import Rig
from qlvbayes.diagnosis.nexttest.screening import screened
from qlvbayes.io.checks import InputError

Array = NDArray[np.float64]

SCREENED = 1024
"""Designs that are drawn."""
BEST = 5
"""Of these, that are judged without taking forces for linear."""
MOST = 5
"""Tests in a series."""
_AS_GOOD = 0.01  # bits, by which a total may be less than the most: the shortest of these is taken


@dataclass(frozen=True)
class Wish:
    """What the tests are for: names of constants, and whether for the cause.

    Constants are known better by every test, so that bits a minute count. A cause is found or not:
    all bits within the time there is count, as the quickest test tells a part of the question only.
    """

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
    explanations of two causes; judged: by nested Monte Carlo, of this test alone.
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
    """Tests that tell most in at most ``minutes`` together; of constants alone, most per minute.

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
    plan = _Plan(belief, wish, designs, products, sound, minutes, min(tests, MOST))
    allowed = plan.best_share(options)
    first = [options[k] for k in _best(options, wish, allowed)[: max(best, 1)]]
    tell(f"judging the best {len(first)}")
    first = [replace(one, judged=judge([one])) for one in first]
    first = [first[k] for k in _best(first, wish, np.full(len(first), True))]
    chosen, told = plan.grown(first[0])
    tell("judging them together")
    return Series(tuple(chosen), tuple(first), int(sound.sum()), judge(chosen), none, told)


@dataclass(frozen=True, eq=False)
class _Plan:
    """Of what a series is made: designs (T,) with their products, which are sound, and limits."""

    belief: Belief
    wish: Wish
    designs: Sequence[Design]
    products: Products
    sound: NDArray[np.bool_]
    minutes: float
    tests: int

    def best_share(self, options: Sequence[Option]) -> NDArray[np.bool_]:
        """Which may come first: all that fit, or those that leave their share to each other test.

        Where all bits count, the longest test may leave no time for others that tell more than it.
        """
        if not self.wish.cause or self.tests == 1:
            return self.sound
        length = np.array([one.design.minutes for one in options])
        found = [self.sound, self.sound & (length <= self.minutes / self.tests)]
        kept = [some for some in found if some.any()]
        series = [self.grown(options[int(_best(options, self.wish, some)[0])]) for some in kept]
        totals = [sum(bits(one, self.wish) for one in chosen) for chosen, _ in series]
        return kept[int(np.argmax(totals))]

    def grown(self, first: Option) -> tuple[list[Option], Products]:
        """The best tests after a first one, each the best of what fits; products (1,) of all."""
        chosen = [first]
        told = self.products[np.array([list(self.designs).index(first.design)])]
        while len(chosen) < self.tests:
            left = self.minutes - sum(one.design.minutes for one in chosen)
            pause = self.belief.recovery.time(chosen[-1].design.duration)
            waiting = [replace(one, wait=max(one.wait, pause)) for one in self.designs]
            more = _options(self.belief, waiting, self.products, self.wish, told)
            length = np.array([one.design.minutes for one in more])
            share = self.sound & (length <= left / (self.tests - len(chosen)))
            fits = share if self.wish.cause and share.any() else self.sound & (length <= left)
            if not fits.any():
                break
            k = int(_best(more, self.wish, fits)[0])
            chosen.append(more[k])
            told = told + self.products[np.array([k])]
        return chosen, told


def _no_time(belief: Belief, minutes: float) -> InputError:
    least = max(belief.recovery.time(1.0), LEAST_WAIT)
    return InputError(
        f"no test fits into {minutes:g} minutes: the pause before one takes {least:.0f} s or more",
        remedy="give more --minutes",
    )


def bits(one: Option, wish: Wish) -> float:
    """Of what is wished for, judged where that was done."""
    if one.judged is not None:
        found = float(wish.total(np.array(one.judged.constants), np.array(one.judged.cause)))
        if np.isfinite(found):
            return found
    return float(wish.total(np.array(one.constants), np.array(one.cause)))


def rate(one: Option, wish: Wish) -> float:
    """The same per minute."""
    return bits(one, wish) / one.design.minutes


def _options(
    belief: Belief, designs: Sequence[Design], products: Products, wish: Wish, told: Products
) -> list[Option]:
    """Every design, after the tests of which the products are ``told`` (1,)."""
    p, groups = belief.probabilities, belief.groups
    after = products + told
    constants = bits_for_constants(belief, after, wish.constants)
    constants -= bits_for_constants(belief, told, wish.constants)
    bounds = zip(after.bits_for_cause(p, groups), told.bits_for_cause(p, groups), strict=True)
    low, high = (np.maximum(new - old, 0.0) for new, old in bounds)
    columns = (constants, low, high, evidence(after, groups))
    rows = zip(designs, *(column.tolist() for column in columns), strict=True)
    return [Option(*row) for row in rows]


def _best(options: Sequence[Option], wish: Wish, allowed: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Places of the options, the best first; those not allowed come last.

    Where all bits count, the quickest of those that tell as good as most comes first.
    """
    worth = bits if wish.cause else rate
    found = np.where(allowed, [worth(one, wish) for one in options], -np.inf)
    order = np.argsort(-found, kind="stable")
    if not wish.cause:
        return order
    near = [k for k in order if found[k] >= found[order[0]] - _AS_GOOD]
    first = min(near, key=lambda k: options[k].design.minutes)
    return np.array([first, *(k for k in order if k != first)])
