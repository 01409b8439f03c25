"""Sentences of a first look."""

from __future__ import annotations

from collections.abc import Sequence

from qlvbayes.io.data import Control
from qlvbayes.io.units import UnitSystem
from qlvbayes.io.wording import joined, plain
from qlvbayes.motion.phases import KINDS, NAMES, phase_name, span
from qlvbayes.report.firstlook.result import BY_PHASE, PadSeen, PhaseSeen

_EACH = 6  # phases that are listed one by one
_SLOWER = 0.1  # of its declared speed, by which a test may miss it
_AGREES = 2.0  # standard errors from zero depth
_NAMED = 3  # tests that are named
_MANY = {"ramp": "ramps", "hold": "holds", "unload": "unloadings", "recovery": "recoveries"}


def phases_in_words(phases: Sequence[PhaseSeen]) -> str:
    """Format phases as 'ramp 16 ms, hold 30 s', or by number and length if there are many."""
    if len(phases) <= _EACH:
        return ", ".join(
            f"{phase_name(p.phase, p.control)} {span(p.stop - p.start)}" for p in phases
        )
    parts = []
    for kind in KINDS:
        lengths = [phase.stop - phase.start for phase in phases if phase.phase == kind]
        if not lengths:
            continue
        low, high = span(min(lengths)), span(max(lengths))
        name = NAMES[kind] if len(lengths) == 1 else _MANY[kind]
        parts.append(f"{len(lengths)} {name} of {low if low == high else f'{low} to {high}'}")
    return joined(parts)


def lines_of(pad: PadSeen, units: UnitSystem) -> list[str]:
    """Return one line each on a pad's readings."""
    slow = [
        f"test {test.test} declares {plain(test.rate)} and reaches {plain(test.reached)}"
        for test in pad.tests
        if test.rate and test.reached and abs(test.reached / test.rate - 1.0) > _SLOWER
    ]
    return [
        f"noise of the {units.force_name}: {_noise(pad, units)}",
        *([f"speed: {joined(_some(slow, ' in look.json'))} {units.speed}"] if slow else []),
        *_motion(pad, units),
        *_contact(pad, units),
        *_clock(pad),
        *_control(pad, units),
        *(
            f"{'beyond doubt' if one.beyond_doubt else 'perhaps'} {one.effect}: {one.sentence}"
            for one in pad.direct_evidence
        ),
    ]


def _noise(pad: PadSeen, units: UnitSystem) -> str:
    noise, peak = pad.noise, max(test.peak for test in pad.tests)
    head = f"{plain(noise.total)} {units.force}"
    if noise.by_reading:
        return f"{head}, root mean square of sds that differ from reading to reading"
    share = f" ({100.0 * noise.total / peak:.2g} % of the largest)" if peak > 0.0 else ""
    parts = f"white {plain(noise.white, 2)}"
    if noise.correlated > 0.0:
        parts += f", correlated {plain(noise.correlated, 2)} over {span(noise.tau)}"
    return f"{head} a reading{share}: {parts}"


def _some(named: Sequence[str], where: str = "") -> list[str]:
    """Return the first few of some names, and how many more there are."""
    more = len(named) - _NAMED
    return [*named[:_NAMED], *([f"{more} more{where}"] if more > 0 else [])]


def _motion(pad: PadSeen, units: UnitSystem) -> list[str]:
    unit = "" if units.displacement == "1" else f" {units.displacement}"
    worst = max(pad.tests, key=lambda test: test.motion.largest)
    steps = sorted({float(plain(t.motion.step, 2)) for t in pad.tests if t.motion.step_shows})
    of = f" (the encoder's step is {joined([plain(step) for step in steps], 'or')}{unit})"
    parts = [
        f"motion: fitted to the {units.displacement_name} within "
        f"{plain(worst.motion.largest, 2)}{unit} of every reading{of if steps else ''}"
    ]
    return parts + [test.motion.departure for test in pad.tests if test.motion.departure]


def _contact(pad: PadSeen, units: UnitSystem) -> list[str]:
    if units.dimensionless:  # a strip in strain has no contact
        return []
    contacts = [(test.test, test.contact) for test in pad.tests if test.contact is not None]
    if not contacts:
        return ["contact: no test shows an approach, so that depth counts from the zero as it is"]
    off = [
        f"{plain(seen.position, 2)} +- {plain(seen.sd, 1)} {units.displacement} in test {name}"
        for name, seen in contacts
        if abs(seen.position) > _AGREES * seen.sd
    ]
    agree, most = len(contacts) - len(off), max(seen.sd for _, seen in contacts)
    sentences = []
    if agree:
        one = len(contacts) == 1
        those = "the one test that shows" if one else f"{agree} of {len(contacts)} tests"
        sentences.append(
            f"the rise of the {units.force_name} agrees with zero depth in {those} "
            f"{'' if one else 'that show '}an approach (errors up to {plain(most, 1)} "
            f"{units.displacement})"
        )
    if len(off) > _NAMED:
        off = [*off[:_NAMED], f"others ({len(off) - _NAMED} more in look.json)"]
    if off:
        sentences.append(
            f"the {units.force_name} rises out of its noise at {joined(off)}, where a soft "
            "beginning may look alike"
        )
    return [f"contact: {'; '.join(sentences)}"]


def _clock(pad: PadSeen) -> list[str]:
    sentences = []
    off = max(pad.tests, key=lambda test: test.clock_sd / test.interval)
    if off.clock_sd > 0.0:
        sentences.append(
            f"clock: stamps of test {off.test} are off by {span(off.clock_sd)} (sd), of intervals "
            f"of {span(off.interval)}"
        )
    remembering = [test.test for test in pad.tests if test.after]
    if remembering:
        sentences.append(
            f"rest: {_tests(remembering)} begin{'s' if len(remembering) == 1 else ''} while the "
            "specimen still recovers from an earlier test, which a fit takes into account"
        )
    return sentences


def _control(pad: PadSeen, units: UnitSystem) -> list[str]:
    force = [test.test for test in pad.tests if test.control == Control.FORCE]
    by_phase = [test for test in pad.tests if test.control == BY_PHASE]
    if not force and not by_phase:
        return []
    where = [_tests(force)] if force else []
    for test in by_phase[:_NAMED]:  # as 'hold (1.8 to 3.8 s) of test a'
        loaded = [phase for phase in test.phases if phase.control == Control.FORCE]
        spans = [f"{NAMES[p.phase]} ({plain(p.start)} to {plain(p.stop)} s)" for p in loaded]
        where.append(f"{joined(_some(spans, ' phases'))} of test {test.test}")
    if len(by_phase) > _NAMED:
        where.append(f"phases of {len(by_phase) - _NAMED} more tests (in look.json)")
    rest = len(pad.tests) - len(force)
    elsewhere = "elsewhere" if by_phase else "in the others"
    others = f"; the {units.displacement_name} {elsewhere}" if rest else ""
    return [f"control: the {units.force_name} is prescribed in {joined(where)}{others}"]


def _tests(names: Sequence[str]) -> str:
    return f"test{'' if len(names) == 1 else 's'} {joined(_some(names))}"
