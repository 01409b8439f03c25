"""From a series of tests to all that is told of it."""

from __future__ import annotations

import math
from collections.abc import Sequence

from qlvbayes.diagnosis.nexttest.belief import Belief
from qlvbayes.diagnosis.nexttest.errors import Errors
from qlvbayes.diagnosis.nexttest.montecarlo import Judged
from qlvbayes.diagnosis.nexttest.result import Bits, Hypothesis, Limits, NextTests, Proposed, Width
from qlvbayes.diagnosis.nexttest.rig import Rig
from qlvbayes.diagnosis.nexttest.series import Option, Series, Wish, bits, rate
from qlvbayes.diagnosis.nexttest.setpoints import names_of
from qlvbayes.io.units import UnitSystem

_DOUBT = 0.5  # probability of something outside, from which it is said


def told(
    pad: str,
    units: UnitSystem,
    belief: Belief,
    rig: Rig,
    errors: Errors,
    wish: Wish,
    series: Series,
    *,
    minutes: float,
    seed: int,
) -> NextTests:
    """All of it, in the units of the tests that were done."""
    own = names_of(len(series.tests))
    tests = [_proposed(name, one, units, wish) for name, one in zip(own, series.tests, strict=True)]
    return NextTests(
        pad=pad,
        units=units,
        constants=wish.constants,
        cause=wish.cause,
        limits=Limits(rig.depth, rig.speed, rig.acceleration, rig.interval, rig.rows),
        minutes=minutes,
        seed=seed,
        screened=series.screened,
        hypotheses=tuple(Hypothesis(o.words, o.probability, o.cause) for o in belief.explanations),
        entropy=belief.entropy,
        outside=belief.outside,
        missed=errors.missed,
        tests=tuple(tests),
        considered=tuple(
            _proposed(f"option-{k + 1}", one, units, wish) for k, one in enumerate(series.options)
        ),
        together=_bits(series.judged),
        widths=_widths(belief, series, units),
        notices=tuple(_notices(belief, errors, series, units)),
        causes=belief.causes,
    )


def _proposed(name: str, one: Option, units: UnitSystem, wish: Wish) -> Proposed:
    design = one.design
    return Proposed(
        name=name,
        words=design.words(units),
        depth=design.depth,
        speed=design.speed,
        acceleration=design.acceleration,
        hold=design.hold,
        share=design.share,
        rest=design.rest,
        cycles=design.cycles,
        pause=design.wait,
        duration=design.duration,
        minutes=design.minutes,
        constants=one.constants,
        cause=one.cause,
        cause_most=one.cause_most,
        per_minute=rate(one, wish),
        evidence=one.evidence,
        judged=_bits(one.judged),
        total=bits(one, wish),
    )


def _bits(found: Judged | None) -> Bits | None:
    if found is None:
        return None
    values = (found.constants, found.constants_error, found.cause, found.cause_error)
    return Bits(*(value if math.isfinite(value) else None for value in values))


def _widths(belief: Belief, series: Series, units: UnitSystem) -> dict[str, Width]:
    one = belief.explanations[0]
    now, after = (p.sds(0, one.gradient)[0] for p in (series.now, series.after))
    return {
        name: Width(units.of(kind), float(mean), float(a), float(b))
        for name, kind, mean, a, b in zip(one.names, one.kinds, one.centre, now, after, strict=True)
        if a > 0.0
    }


def _notices(belief: Belief, errors: Errors, series: Series, units: UnitSystem) -> Sequence[str]:
    said = []
    if belief.outside > _DOUBT:
        said.append(
            f"with probability {belief.outside:.2g} none of these explanations is all of it: the "
            "tests are judged with what they leave, and bits for the cause are among them only"
        )
    if errors.missed > 0.0:
        said.append(
            f"{errors.missed:.2g} {units.force} that the model leaves count as an error of every "
            "test"
        )
    if belief.recovery.time(series.tests[-1].design.duration) >= 3600.0:
        said.append("the pad recovers more slowly than within an hour: pauses end before it has")
    return said
