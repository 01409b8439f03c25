"""Plan a series: the tests with most information within the time there is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from qlvbayes.diagnosis.nexttest.belief import Belief
from qlvbayes.diagnosis.nexttest.design import LEAST_WAIT, Design, Rig, draw_designs
from qlvbayes.diagnosis.nexttest.information import Products, evidence, screen
from qlvbayes.diagnosis.nexttest.records import ReadingErrors
from qlvbayes.io.arrays import Array
from qlvbayes.io.catalogue import MOST_TESTS
from qlvbayes.io.checks import InputError

SCREENED = 1024
"""Number of designs that are drawn."""
_AS_GOOD = 0.01  # bits by which a total may be below the largest; the shortest test is taken then


@dataclass(frozen=True)
class Goal:
    """Goal of the tests: to know constants, the cause of a misfit, or both.

    Every test makes constants better known, so that bits per minute count. Of a cause all bits
    within the time there is count, as the quickest test gives only a part of the answer.
    """

    constants: tuple[str, ...]  # names of the constants that are asked for
    cause: bool  # whether the cause is asked for


@dataclass(frozen=True, eq=False)
class Option:
    """A test and the information that is expected of it."""

    design: Design
    # constants, cause, cause_most: bits in closed form beyond those of the series before it; of the
    # cause the bounds from below and above
    constants: float
    cause: float
    cause_most: float
    # expected 2 ln(Bayes factor) between the two nearest explanations of two causes
    evidence: float

    @property
    def expected_cause(self) -> float:
        """The bits about the cause, between the bounds; see `between`."""
        return between(self.cause, self.cause_most)


def between(low: float, high: float) -> float:
    """Return the expected bits about the cause from their bounds (`Products.bits_for_cause`)."""
    return low + (high - low) / 3.0


@dataclass(frozen=True, eq=False)
class Series:
    """A planned series of tests."""

    tests: tuple[Option, ...]
    screened: int  # number of designs that fitted
    after: Products  # products of all tests

    @property
    def minutes(self) -> float:
        """Minutes of rig time."""
        return sum(one.design.minutes for one in self.tests)


def bits_for_constants(belief: Belief, products: Products, names: Sequence[str]) -> Array:
    """Return the bits (T,) about constants, averaged over the explanations."""
    total = np.zeros(len(products.values))
    for k, one in enumerate(belief.explanations):
        total += one.probability * products.bits_for(k, one.directions(names))
    return total


def plan_series(
    belief: Belief,
    rig: Rig,
    errors: ReadingErrors,
    goal: Goal,
    *,
    minutes: float,
    tests: int,
    clock: float = 0.0,
    seed: int = 0,
    count: int = SCREENED,
    report: Callable[[str], None] = lambda text: None,
) -> Series:
    """Return the series of tests with most information within the time there is (minutes)."""
    report(f"screening {count} tests")
    designs = draw_designs(rig, belief.recovery, 60.0 * minutes, count, seed)
    if not designs:
        raise _no_time(belief, minutes)
    products, finite = screen(belief, designs, rig, errors, clock)
    none = Products.none(products.sizes)
    if not finite.any():
        raise InputError("no test has a finite force", remedy="give lower limits of the rig")

    options = _options(belief, designs, products, goal, none)
    plan = _Plan(belief, goal, designs, products, finite, minutes, min(tests, MOST_TESTS))
    chosen, after = plan.extend(_best(options, goal, plan.allowed_first(options)))
    return Series(tuple(chosen), int(finite.sum()), after)


@dataclass(frozen=True, eq=False)
class _Plan:
    """The designs from which a series is put together, and its limits."""

    # belief, goal: explanations with their probabilities, and what the tests are for
    belief: Belief
    goal: Goal
    # designs, products: T designs with their products
    designs: Sequence[Design]
    products: Products
    finite: NDArray[np.bool_]  # which of them (T,) give finite forces
    # minutes, tests: time for all tests, and their largest number
    minutes: float
    tests: int

    def allowed_first(self, options: Sequence[Option]) -> NDArray[np.bool_]:
        """Return a mask (T,) of the options that may come first."""
        if not self.goal.cause or self.tests == 1:
            return self.finite
        length = np.array([one.design.minutes for one in options])
        masks = [self.finite, self.finite & (length <= self.minutes / self.tests)]
        kept = [mask for mask in masks if mask.any()]
        firsts = [_best(options, self.goal, mask) for mask in kept]
        totals = [sum(bits(one, self.goal) for one in self.extend(one)[0]) for one in firsts]
        return kept[int(np.argmax(totals))]

    def extend(self, first: Option) -> tuple[list[Option], Products]:
        """Return the series that begins with a test, and the products (1,) of all its tests."""
        chosen = [first]
        total = self.products[np.array([list(self.designs).index(first.design)])]
        while len(chosen) < self.tests:
            left = self.minutes - sum(one.design.minutes for one in chosen)
            pause = self.belief.recovery.time(chosen[-1].design.duration)
            waiting = [replace(one, wait=max(one.wait, pause)) for one in self.designs]
            more = _options(self.belief, waiting, self.products, self.goal, total)
            length = np.array([one.design.minutes for one in more])
            share = self.finite & (length <= left / (self.tests - len(chosen)))
            fits = share if self.goal.cause and share.any() else self.finite & (length <= left)
            if not fits.any():
                break
            chosen.append(best := _best(more, self.goal, fits))
            total = total + self.products[np.array([more.index(best)])]
        return chosen, total


def _no_time(belief: Belief, minutes: float) -> InputError:
    """Return the error that no test fits into the time."""
    least = max(belief.recovery.time(1.0), LEAST_WAIT)
    return InputError(
        f"no test fits into {minutes:g} minutes: the pause before one takes {least:.0f} s or more",
        remedy="give more --minutes",
    )


def bits(one: Option, goal: Goal) -> float:
    """Return the bits about everything that is asked for."""
    return one.constants * bool(goal.constants) + one.expected_cause * goal.cause


def rate(one: Option, goal: Goal) -> float:
    """Return the bits about everything asked for per minute."""
    return bits(one, goal) / one.design.minutes


def _options(
    belief: Belief, designs: Sequence[Design], products: Products, goal: Goal, before: Products
) -> list[Option]:
    """Return every design as an option after tests with the products ``before`` (1,)."""
    p, groups = belief.probabilities, belief.groups
    after = products + before
    constants = bits_for_constants(belief, after, goal.constants)
    constants -= bits_for_constants(belief, before, goal.constants)
    bounds = zip(after.bits_for_cause(p, groups), before.bits_for_cause(p, groups), strict=True)
    low, high = (np.maximum(new - old, 0.0) for new, old in bounds)
    columns = (constants, low, high, evidence(after, groups))
    rows = zip(designs, *(column.tolist() for column in columns), strict=True)
    return [Option(*row) for row in rows]


def _best(options: Sequence[Option], goal: Goal, allowed: NDArray[np.bool_]) -> Option:
    """Return the best of the allowed options."""
    worth = bits if goal.cause else rate
    values = np.where(allowed, [worth(one, goal) for one in options], -np.inf)
    if not goal.cause:
        return options[int(np.argmax(values))]
    near = np.flatnonzero(values >= values.max() - _AS_GOOD).tolist()
    return min((options[k] for k in near), key=lambda one: one.design.minutes)
