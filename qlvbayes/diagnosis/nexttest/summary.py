"""The summary of a planned series of tests: every field of ``design.json``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict

import numpy as np

from qlvbayes.diagnosis.nexttest.belief import Belief
from qlvbayes.diagnosis.nexttest.design import Rig, names_of
from qlvbayes.diagnosis.nexttest.records import ReadingErrors
from qlvbayes.diagnosis.nexttest.result import (
    Bits,
    ExplanationSummary,
    NextTests,
    Proposed,
    Width,
)
from qlvbayes.diagnosis.nexttest.series import (
    Goal,
    Option,
    Series,
    between,
    bits,
    bits_for_constants,
    rate,
)
from qlvbayes.io.units import UnitSystem
from qlvbayes.io.wording import plain

_CONSTANTS_ERROR, _CAUSE_ERROR = 0.016, 0.2
"""Errors of the closed form, one sd: share of the bits about constants, and of the distance between
the bounds of those about the cause. Each is the sd, over 72 tests of simulated pads, of what nested
Monte Carlo gives instead (docs/reliability.md).
"""
_DOUBT = 0.5  # probability of something unmodelled from which a notice says so


def summarize(
    pad: str,
    units: UnitSystem,
    belief: Belief,
    rig: Rig,
    errors: ReadingErrors,
    goal: Goal,
    series: Series,
    *,
    minutes: float,
    seed: int,
) -> NextTests:
    """Return the result of a planned series, in the units of the tests that were done."""
    own = names_of(len(series.tests))
    constants = bits_for_constants(belief, series.after, goal.constants)
    bounds = series.after.bits_for_cause(belief.probabilities, belief.groups)
    tests = [_proposed(name, one, units, goal) for name, one in zip(own, series.tests, strict=True)]
    return NextTests(
        pad=pad,
        units=units,
        constants=goal.constants,
        cause=goal.cause,
        limits=rig,
        minutes=minutes,
        seed=seed,
        screened=series.screened,
        hypotheses=tuple(
            ExplanationSummary(one.words, one.probability, one.cause) for one in belief.explanations
        ),
        entropy=belief.entropy,
        outside=belief.outside,
        missed=errors.missed,
        tests=tuple(tests),
        together=_bits(*(float(value[0]) for value in (constants, *bounds))),
        widths=_widths(belief, series, units),
        notices=tuple(_notices(belief, errors, series, units)),
        causes=belief.causes,
    )


def _proposed(name: str, one: Option, units: UnitSystem, goal: Goal) -> Proposed:
    """Return the record of one test."""
    design = one.design
    return Proposed(
        name=name,
        words=design.words(units),
        **asdict(design),
        duration=design.duration,
        minutes=design.minutes,
        constants=one.constants,
        cause=one.cause,
        cause_most=one.cause_most,
        per_minute=rate(one, goal),
        evidence=one.evidence,
        judged=_bits(one.constants, one.cause, one.cause_most),
        total=bits(one, goal),
    )


def _bits(constants: float, low: float, high: float) -> Bits:
    """Return the expected bits with the errors of the closed form."""
    errors = _CONSTANTS_ERROR * constants, _CAUSE_ERROR * (high - low)
    return Bits(constants, errors[0], between(low, high), errors[1])


def _widths(belief: Belief, series: Series, units: UnitSystem) -> dict[str, Width]:
    """Return the sds of the constants now and after all tests."""
    one = belief.explanations[0]
    now, after = np.linalg.norm(one.gradient, axis=1), series.after.sds(0, one.gradient)[0]
    return {
        name: Width(units.of(kind), float(mean), float(a), float(b))
        for name, kind, mean, a, b in zip(one.names, one.kinds, one.centre, now, after, strict=True)
        if a > 0.0
    }


def _notices(
    belief: Belief, errors: ReadingErrors, series: Series, units: UnitSystem
) -> Sequence[str]:
    """Return what one should know of the plan."""
    notices = []
    if belief.outside > _DOUBT:
        notices.append(
            f"with probability {belief.outside:.2g} something is there that none of these "
            "explanations holds: what they leave counts as an error of every test, and bits for "
            "the cause distinguish only between them"
        )
    if errors.missed > 0.0:
        notices.append(
            f"{plain(errors.missed, 2)} {units.force} that the model leaves count as an error "
            "of every test"
        )
    if belief.recovery.time(series.tests[-1].design.duration) >= 3600.0:
        notices.append("the pad recovers more slowly than within an hour: pauses end before it has")
    return notices
