"""Decide which parts of a model a pad's tests can show, from movements and holds alone.

A part is shown where a change of it changes the force in a way that no other part makes as well,
in tests like these: relaxation in a hold as long as its time constant, a force that grows with the
speed in two speeds, a change with depth in holds at two depths. Only
a fit shows whether it is larger than the noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import floor, log10

import numpy as np

from qlvbayes.io.catalogue import READINGS_A_PERIOD, SLOWEST_HZ
from qlvbayes.io.data import Control
from qlvbayes.io.units import UnitSystem
from qlvbayes.io.wording import joined, plain, rated
from qlvbayes.motion.experiment import Experiment
from qlvbayes.motion.facts import (
    DEEPER,
    OF_UNLOADING,
    Facts,
    at_one_depth,
    loaded_once,
    noise_of,
    returns,
    unloads,
)
from qlvbayes.motion.phases import span
from qlvbayes.report.firstlook.result import Answer, PadSeen, Shown

_OF_SPEED = ("viscous_drag", "power_law_drag", "squeeze_film")
_OF_DEPTH = ("strain_dependent_rate", "strain_dependent_strength")

_FEWEST = 10  # readings on the way in, that show a curve
_CLEAR = 20.0  # times the noise: a peak of which a few per cent are seen
_FASTER = 2.0  # times a speed: another one
_WIDE = 3.0  # longest over shortest time: a relaxation between them is seen
_LEFT = 0.1  # of a movement: relaxation as quick has lost nine tenths of itself when it ends
_STILL = 0.01  # of the peak, by which the force of a finished relaxation does not change
_OFTENER = "record more often while the platen starts and stops"
_ALIKE = 2.0  # longest holds that differ by more do not show the same relaxation
_NAMED = 4  # depths or speeds that are named


_Seen = tuple[Answer, str, str]
"""An answer, the fact behind it, and the test that would show it, empty where they do."""


def shown_by(experiment: Experiment, facts: Facts, *, bonded: bool) -> tuple[Shown, ...]:
    """Return whether a pad's tests can show each part of the model."""
    sliding = ("interface_slip",) if bonded else ()  # a loose specimen does not slide
    once, remedy = len(experiment.trials) == 1, "move back all the way"
    back: _Seen = "no", "no test retracts to zero depth", remedy
    if bonded:
        back = "no", "the specimen is fixed to the platen", ""
    elif returns(experiment):
        back = "yes", "a test comes back to zero depth or to no force", ""
    still: _Seen = "no", "no acceleration is resolved", _OFTENER
    if any(trial.trajectory.acceleration_resolved for trial in experiment.trials):
        still = "yes", "the acceleration is resolved", ""
    again: _Seen = "no", "there is only one test", "repeat it"
    if not once:
        again = "yes", f"{len(experiment.trials)} tests, one after the other", ""
    parts: list[tuple[str, tuple[str, ...], tuple[str, ...], _Seen]] = [
        ("stiffness and its growth with depth", ("m", "b"), (), _stiffness(experiment, facts)),
        ("relaxation", ("c", "v"), (), _relaxation(experiment, facts)),
        ("a force that grows with speed", (), _OF_SPEED, _speed(experiment, facts)),
        *((about, (), effects, seen) for about, effects, seen in _depth(experiment, facts)),
        ("softening and a set that stays", (), (*OF_UNLOADING, *sliding), _unloading(experiment)),
        ("adhesion", (), ("adhesion",), back),
        ("inertia", (), ("inertia",), still),
        ("ringing after a stop", (), ("frame_ringing",), _ringing(experiment)),
        ("a change with the clock", (), ("fluid_leak", "force_drift"), _clock(experiment)),
        ("conditioning, from test to test", (), ("conditioning",), again),
        ("prediction of unseen tests", (), (), _validation(experiment, facts)),
    ]
    return tuple(
        Shown(about, *seen, constants, effects) for about, constants, effects, seen in parts
    )


def _stiffness(experiment: Experiment, facts: Facts) -> _Seen:
    readings = sum(move.readings for move in facts.moves if move.kind == "ramp")
    levels = apart(facts.levels, DEEPER)
    noise, units = noise_of(experiment), experiment.units
    ratio = experiment.peak / noise if noise > 0.0 else np.inf
    deep = f"{plain(experiment.depth)} {units.displacement}".removesuffix(" 1")
    clear = f"up to {deep}"
    if experiment.floor.testable:  # else nobody knows the noise so well
        clear += f"; the largest {units.force_name} is {plain(ratio, 2)} times the noise"
        if ratio < _CLEAR:
            return "hardly", clear, "press deeper, or use a load cell of a smaller range"
    if readings >= _FEWEST:
        return "yes", f"{readings} readings on the way in, {clear}", ""
    if len(levels) >= 3:
        return "yes", f"holds at {len(levels)} depths, {clear}", ""
    those = f"{readings or 'no'} reading{'' if readings == 1 else 's'}"
    remedy = "record the way in more often, or hold at three depths"
    return "hardly", f"{those} on the way in: a curve needs more", remedy


def _relaxation(experiment: Experiment, facts: Facts) -> _Seen:
    quick, slow = facts.durations
    shortest = max(facts.interval, _LEFT * quick)
    longest = max(facts.longest_hold, slow)
    if not facts.holds:
        speeds = apart(facts.speeds, _FASTER)
        remedy = "hold at depth, as long as the slowest relaxation that matters"
        if len(facts.moves) < 3 and len(speeds) < 2:
            reason = "no hold and one speed: relaxation and stiffness cannot be distinguished"
            return "no", reason, remedy
        several = "the movements alone" if len(speeds) < 2 else "different speeds alone"
        reason = f"no hold: by {several}, times up to {span(slow)} (the longest movement)"
        return "hardly", reason, remedy
    sampled = facts.interval > _LEFT * quick
    bound = "the interval between readings" if sampled else "a tenth of the quickest movement"
    window = f"times from {span(shortest)} ({bound}) to {span(longest)}"
    longer = facts.longest_hold >= slow
    window += " (the longest hold)" if longer else " (the longest movement; no hold is as long)"
    if longest < _WIDE * shortest:
        return "hardly", f"{window}: hardly any range", "hold longer, or press faster"
    modes = max(1, floor(log10(longest / shortest)))
    many = "one relaxation time" if modes == 1 else f"up to {modes} relaxation times"
    reason = f"{window}: {many}, about one a decade"
    long = [hold for hold in facts.holds if _ALIKE * hold.duration > facts.longest_hold]
    moving = max(long, key=lambda hold: abs(hold.change))  # in its second half
    if abs(moving.change) < _STILL:
        return "yes", reason, ""
    units = experiment.units
    name = units.displacement_name if moving.control == Control.FORCE else units.force_name
    reason += (
        f"; in the second half of the longest hold the {name} still changes by "
        f"{100.0 * abs(moving.change):.2g} % of the largest"
    )
    return "yes", reason, "slower relaxation needs a longer hold"


def _speed(experiment: Experiment, facts: Facts) -> _Seen:
    unit = experiment.units.speed
    if not any(trial.trajectory.velocity_resolved for trial in experiment.trials):
        return "no", "the displacement records do not give the speed", "record more often"
    speeds = apart(facts.speeds, _FASTER)
    if not speeds:
        return "hardly", "no test moves from one position to another", "press at two speeds"
    if len(speeds) == 1:
        reason = f"one speed, {rated(speeds[0], unit)}, at which it looks like quick relaxation"
        return "hardly", reason, f"press at another speed, {plain(_FASTER)} times as fast or more"
    return "yes", f"speeds from {rated(speeds[0], unit)} to {rated(max(facts.speeds), unit)}", ""


def _depth(experiment: Experiment, facts: Facts) -> list[tuple[str, tuple[str, ...], _Seen]]:
    levels = apart(facts.levels, DEEPER)
    if len(levels) > 1:
        reason = f"holds at {_levels(experiment, facts, levels)}"
        return [("relaxation that changes with depth", _OF_DEPTH, ("yes", reason, ""))]
    what = "force" if facts.held == Control.FORCE else "depth"
    where = f"one {what}, {_levels(experiment, facts, levels)}" if levels else "no depth"
    reason, remedy = f"holds at {where}", "hold at two depths or more"
    moving: _Seen = "hardly", f"{reason}: only the movements could show it", remedy
    share: _Seen = ("no", reason, remedy) if at_one_depth(experiment) else moving
    return [
        ("a relaxation whose speed changes with depth", _OF_DEPTH[:1], moving),
        ("one whose share does", _OF_DEPTH[1:], share),
    ]


def _levels(experiment: Experiment, facts: Facts, levels: Sequence[float]) -> str:
    units = experiment.units
    unit = units.force if facts.held == Control.FORCE else units.displacement
    named = [plain(level) for level in levels]
    if len(named) > _NAMED:
        named = [*named[: _NAMED - 1], f"{len(named) - _NAMED + 1} more"]
    return f"{joined(named)} {unit}".removesuffix(" 1")


def _unloading(experiment: Experiment) -> _Seen:
    if not unloads(experiment):
        return "no", "no test unloads", "move back in a test"
    if loaded_once(experiment):
        reason = "one test, no load of which goes deeper than the first: they look much alike"
        remedy = "press a fresh specimen in steps, back after each, to growing depths"
        return "hardly", reason, remedy
    return "yes", "the platen moves back in a test", ""


def _ringing(experiment: Experiment) -> _Seen:
    interval = experiment.interval
    if not any(trial.trajectory.velocity_resolved for trial in experiment.trials):
        return "no", "no velocity is resolved", _OFTENER
    if READINGS_A_PERIOD * SLOWEST_HZ * interval > 1.0:
        reason = f"readings are {plain(interval, 2)} s apart, and frames swing quicker"
        return "no", reason, _OFTENER
    return "yes", f"up to {plain(1.0 / (READINGS_A_PERIOD * interval), 2)} Hz", ""


def _clock(experiment: Experiment) -> _Seen:
    count = len(experiment.trials)
    if count == 1:
        reason = "one test, in which it looks like slow relaxation"
        return "hardly", reason, "repeat the first test last"
    if all(trial.test.start_known for trial in experiment.trials):
        return "yes", f"{count} tests, and the clock between them", ""
    reason = f"{count} tests, but the file does not say when each began (no column start_s)"
    remedy = "write start_s; until then tests follow one another without a pause"
    return "hardly", reason, remedy


def _validation(experiment: Experiment, facts: Facts) -> _Seen:
    fitted, others = experiment.with_role("fit"), experiment.with_role("validate")
    if fitted and others:
        plural = "s" if len(others) > 1 else ""
        names = joined([trial.name for trial in fitted][:_NAMED])
        return "yes", f"{len(others)} test{plural} can be predicted from {names}", ""
    if len(experiment.trials) > 1:
        return "hardly", "every test has the role fit", "give one the role validate"
    if facts.loads <= 1:
        what = "one test with one load: its constants can be fitted, but few effects can be named"
        return "no", what, "press again, at another speed or to another depth"
    return "no", "one test: nothing is left to predict", "press again in another test"


def shown_between(pads: Sequence[PadSeen], units: UnitSystem) -> tuple[Shown, ...]:
    """Return whether constants of pads can be compared: tested with similar holds and depths."""
    if len(pads) < 2:
        return ()
    holds = {pad.pad: _longest_hold(pad) for pad in pads}
    depths = {pad.pad: max(test.depth for test in pad.tests) for pad in pads}
    answers = []
    for of, what, values, most, unit in (
        ("relaxation", "held for", holds, _ALIKE, "s"),
        ("stiffness", "pressed to", depths, DEEPER, units.displacement),
    ):
        about = f"{of} of the pads, side by side"
        low, high = min(values, key=values.__getitem__), max(values, key=values.__getitem__)
        least, largest = (f"{plain(values[k])} {unit}".removesuffix(" 1") for k in (low, high))
        if values[low] > 0.0 and values[high] <= most * values[low]:
            to = f" to {largest}" if largest != least else ""
            answers.append(Shown(about, "yes", f"all are {what} {least}{to}"))
        else:
            reason = f"pad {low} is {what} {least}, pad {high} {largest}"
            answers.append(Shown(about, "hardly", reason, "test both alike"))
    return tuple(answers)


def _longest_hold(pad: PadSeen) -> float:
    dwells = (
        phase.stop - phase.start
        for test in pad.tests
        for phase in test.phases[1:]  # one that a test begins with follows no movement
        if phase.phase == "hold"
    )
    return max(dwells, default=0.0)


def apart(values: Sequence[float], factor: float) -> list[float]:
    """Return the smallest value, and each that is at least ``factor`` times the one before it."""
    distinct: list[float] = []
    for value in sorted(abs(value) for value in values):
        if value > 0.0 and (not distinct or value >= factor * distinct[-1]):
            distinct.append(value)
    return distinct
