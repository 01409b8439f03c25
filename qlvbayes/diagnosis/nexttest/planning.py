"""Plan the next tests: each is the best one after those before it (``design.json``)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import msgspec
import numpy as np
from msgspec import structs

from qlvbayes.diagnosis.candidate import Candidate, described
from qlvbayes.diagnosis.nexttest.belief import Belief, Explanation, Products, between, screen
from qlvbayes.diagnosis.nexttest.design import LEAST_WAIT, Design, Readings, Rig, draw_designs
from qlvbayes.diagnosis.result import Suggestion
from qlvbayes.io.arrays import Array
from qlvbayes.io.checks import InputError
from qlvbayes.io.files import Part, Result
from qlvbayes.io.units import PAD, UnitSystem
from qlvbayes.io.wording import plain
from qlvbayes.motion.experiment import Experiment

_SCREENED = 1024  # designs that are compared
_AS_GOOD = 0.01  # bits by which a total may be below the largest; the shortest test is taken then
# errors of the closed form: shares of the bits about constants, and of the distance between the
# bounds of those about the cause, one sd over 72 tests of simulated pads (docs/reliability.md)
_CONSTANTS_ERROR, _CAUSE_ERROR = 0.016, 0.2
_DOUBT = 0.5  # probability of something unmodelled from which a notice says so
_FEWER = 64  # designs that are compared for a suggestion
_LONGEST = 600.0  # s, of a suggestion with its pause: the default of 'qlvbayes design'
_SUGGESTED = 5  # tests
_DRAWS = 400  # of an explanation, for its moments


class ExplanationSummary(Part, frozen=True):
    """An explanation of the tests that were done, in words, with its probability and cause."""

    words: str
    probability: float
    cause: str = ""


class Bits(Part, frozen=True):
    """Expected bits about the constants and the cause, with the sds of the closed form's error."""

    constants: float
    constants_error: float
    cause: float
    cause_error: float


class Proposed(Design, frozen=True, kw_only=True, rename={
    "duration": "duration_s", "evidence": "expected_2_ln_bayes_factor",
}):  # fmt: skip
    """A proposed test and the information that is expected of it."""

    name: str
    words: str
    # duration, minutes: time of the test (s), and with the pause before it (min)
    duration: float
    minutes: float
    # constants, cause, cause_most: bits in closed form beyond those of the tests before it; of the
    # cause the bounds from below and above
    constants: float
    cause: float
    cause_most: float
    judged: Bits  # bits expected of this test, with the errors of the closed form
    # total, per_minute: bits about everything that was asked for, in all and per minute
    total: float
    per_minute: float
    # expected 2 ln(Bayes factor) between the two nearest explanations of two causes, together with
    # the tests before it
    evidence: float


class Width(Part, frozen=True):
    """The sd of a constant now and after all tests, by the most probable explanation."""

    unit: str
    mean: float
    now: float
    after: float


class NextTests(Result, frozen=True, kw_only=True):
    """The tests to do next: ``design.json``."""

    pad: str
    units: UnitSystem = PAD  # of the pad's file
    # constants, cause: constants that were asked for, and whether the cause was
    constants: tuple[str, ...]
    cause: bool
    limits: Rig  # limits of the rig, and how many tests were done before
    minutes: float
    seed: int
    screened: int  # number of designs that fitted
    hypotheses: tuple[ExplanationSummary, ...]
    entropy: float  # bits that are missing to know which cause is right
    outside: float  # probability that something unmodelled is there
    missed: float  # size of what the explanations leave (N), which counts as an error of every test
    tests: tuple[Proposed, ...]
    together: Bits  # bits of all proposed tests, with the errors of the closed form
    widths: dict[str, Width]
    notices: tuple[str, ...] = ()  # what one should know
    # probability of each set of effects over all laws
    causes: dict[str, float] = msgspec.field(default_factory=dict)


@dataclass(frozen=True)
class Goal:
    """Purpose of the tests: to know constants, the cause of a misfit, or both.

    Every test makes constants better known, so that bits per minute count. Of a cause all bits
    within the time there is count, as the quickest test gives only a part of the answer: the tests
    share the time evenly.
    """

    constants: tuple[str, ...]  # names of the constants that are asked for
    cause: bool  # whether the cause is asked for
    minutes: float = 10.0  # of rig time for all tests
    tests: int = 3  # at most

    def bits(self, products: Products) -> Array:
        """Return bits (3, T): for the constants, and the bounds of those for the cause."""
        return np.stack([products.bits_for_constants(self.constants), *products.bits_for_cause()])

    def total(self, bits: Array) -> Array:
        """Return the bits (T,) about everything that is asked for."""
        return bits[0] * bool(self.constants) + between(*bits[1:]) * self.cause

    def best(self, bits: Array, minutes: Array, longest: float) -> int | None:
        """Return the best of T tests that take so many minutes; None where all take longer."""
        fits = np.flatnonzero(minutes <= longest)
        total, minutes = self.total(bits[:, fits]), minutes[fits]
        if not fits.size:
            return None
        if not self.cause:
            return int(fits[np.argmax(total / minutes)])
        near = np.flatnonzero(total >= total.max() - _AS_GOOD)
        return int(fits[near[np.argmin(minutes[near])]])


def plan_tests(
    pad: str, units: UnitSystem, belief: Belief, readings: Readings, goal: Goal, *,
    seed: int = 0, count: int = _SCREENED, report: Callable[[str], None] = lambda text: None,
) -> NextTests:  # fmt: skip
    """Return the series of tests with most information within the time there is.

    ``units``: those of the tests that were done. An InputError where no test fits into the time, or
    none that does has a finite force.
    """
    report(f"screening {count} tests")
    designs = draw_designs(readings.rig, belief.recovery, 60.0 * goal.minutes, count, seed)
    if not designs:
        least = max(belief.recovery(1.0), LEAST_WAIT)
        raise InputError(
            f"no test fits into {goal.minutes:g} minutes: the pause before one takes {least:.0f} s "
            "or more",
            remedy="give more --minutes",
        )
    values = screen(belief, designs, readings).values
    finite = np.flatnonzero(np.isfinite(values).all(axis=(1, 2)))
    if not finite.size:
        raise InputError("no test has a finite force", remedy="give lower limits of the rig")
    values, designs = values[finite], [designs[k] for k in finite]
    durations, waits = np.array([(one.seconds, one.wait) for one in designs]).T
    tests: list[Proposed] = []
    done = Products(belief, np.zeros((1, *values.shape[1:])))
    most = min(goal.tests, int(60.0 * goal.minutes / np.min(durations + waits)))
    while len(tests) < most:
        wait = np.maximum(waits, belief.recovery(tests[-1].duration) if tests else 0.0)
        minutes = (durations + wait) / 60.0
        after = Products(belief, done.values + values)
        bits = np.maximum(goal.bits(after) - goal.bits(done), 0.0)
        left = goal.minutes - sum(one.minutes for one in tests)
        best = goal.best(bits, minutes, left / (most - len(tests)) if goal.cause else left)
        if best is None:
            break
        done = Products(belief, done.values + values[best])
        design = structs.replace(designs[best], wait=float(wait[best]))
        total, (constants, *cause) = float(goal.total(bits)[best]), bits[:, best].tolist()
        proposed = Proposed(
            **structs.asdict(design), name=f"next-{len(tests) + 1}", words=design.in_words(units),
            duration=float(durations[best]), minutes=float(minutes[best]),
            constants=constants, cause=cause[0], cause_most=cause[1], judged=_judged(bits[:, best]),
            total=total, per_minute=total / float(minutes[best]),
            evidence=float(done.evidence()[0]),
        )  # fmt: skip
        tests.append(proposed)
    every = belief.explanations
    hypotheses = [ExplanationSummary(one.words, one.probability, one.cause) for one in every]
    return NextTests(
        pad=pad, units=units, constants=goal.constants, cause=goal.cause, limits=readings.rig,
        minutes=goal.minutes, seed=seed, screened=finite.size, hypotheses=tuple(hypotheses),
        entropy=belief.entropy, outside=belief.outside, missed=readings.missed, tests=tuple(tests),
        together=_judged(goal.bits(done)[:, 0]), widths=_widths(done, units),
        notices=tuple(_notices(belief, readings, units)), causes=belief.causes,
    )  # fmt: skip


def _judged(bits: Array) -> Bits:
    """Return the expected bits (3,) with the errors of the closed form."""
    constants, low, high = bits.tolist()
    errors = _CONSTANTS_ERROR * constants, _CAUSE_ERROR * (high - low)
    return Bits(constants, errors[0], float(between(low, high)), errors[1])


def _widths(done: Products, units: UnitSystem) -> dict[str, Width]:
    """Return the sds of the constants now and after all tests, by the likeliest explanation."""
    one = done.belief.explanations[0]
    columns = one.centre, np.linalg.norm(one.gradient, axis=1), done.sds(0, one.gradient)[0]
    rows = np.stack(columns, axis=1).tolist()
    every = zip(one.names, one.kinds, rows, strict=True)
    return {name: Width(units.of(kind), *row) for name, kind, row in every if row[1] > 0.0}


def _notices(belief: Belief, readings: Readings, units: UnitSystem) -> Iterator[str]:
    """Yield what one should know of the plan."""
    if belief.outside > _DOUBT:
        yield (
            f"with probability {belief.outside:.2g} something is there that none of these "
            "explanations holds: what they leave counts as an error of every test, and bits for "
            "the cause distinguish only between them"
        )
    if readings.missed > 0.0:
        yield (
            f"{plain(readings.missed, 2)} {units.force} that the model leaves count as an error "
            "of every test"
        )


def suggest(experiment: Experiment, candidates: Sequence[Candidate]) -> list[Suggestion]:
    """Return the tests that best separate the nearest two of some candidates, the best first."""
    belief = equal_belief(candidates)
    readings = Readings.after(experiment, max(one.mode.size for one in candidates))
    designs = draw_designs(readings.rig, belief.recovery, _LONGEST, _FEWER, 0)
    if not designs:
        return []
    worth = np.nan_to_num(screen(belief, designs, readings).evidence())
    order = np.argsort(-worth, kind="stable")[:_SUGGESTED]
    return [Suggestion(designs[k].in_words(experiment.units), float(worth[k])) for k in order]


def equal_belief(candidates: Sequence[Candidate]) -> Belief:
    """Return a belief in which all candidates are equally probable, each a cause of its own."""
    explanations = []
    for one in sorted(candidates, key=lambda one: described(one.hypothesis)):
        words, rng = described(one.hypothesis), np.random.default_rng(0)
        draws = one.draws(_DRAWS, rng, moved=False)
        known = words, one.point.own.model, draws, 1.0 / len(candidates), words
        explanations.append(Explanation.from_draws(*known))
    return Belief(tuple(explanations))
