"""Decide which parts of a model a pad's tests can show, from movements and holds alone.

A part is shown where a change of it changes the force in a way that no other part makes as well,
in tests like these: relaxation in a hold as long as its time constant, a force that grows with the
speed in two speeds, a change with depth in holds at two depths. Only
a fit shows whether it is larger than the noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
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
from qlvbayes.report.firstlook.result import PadSeen, Shown

OF_SPEED = ("viscous_drag", "power_law_drag", "squeeze_film")
OF_ACCELERATION = ("inertia",)
OF_STOPS = ("frame_ringing",)
OF_SLIDING = ("interface_slip",)
OF_RETRACTION = ("adhesion",)
OF_DEPTH = ("strain_dependent_rate", "strain_dependent_strength")
OF_THE_CLOCK = ("fluid_leak", "force_drift")
OF_TESTS = ("conditioning",)

_FEWEST = 10  # readings on the way in, that show a curve
_CLEAR = 20.0  # times the noise: a peak of which a few per cent are seen
_FASTER = 2.0  # times a speed: another one
_WIDE = 3.0  # longest over shortest time: a relaxation between them is seen
_LEFT = 0.1  # of a movement: relaxation as quick has lost nine tenths of itself when it ends
_STILL = 0.01  # of the peak, by which the force of a finished relaxation does not change
_ALIKE = 2.0  # longest holds that differ by more do not show the same relaxation
_NAMED = 4  # depths or speeds that are named


def shown_by(experiment: Experiment, facts: Facts, *, bonded: bool) -> tuple[Shown, ...]:
    """Return whether a pad's tests can show each part of the model."""
    return (
        _stiffness(experiment, facts),
        _relaxation(experiment, facts),
        _speed(experiment, facts),
        *_depth(experiment, facts),
        _unloading(experiment, bonded=bonded),
        _retraction(experiment, bonded=bonded),
        _acceleration(experiment),
        _ringing(experiment),
        _clock(experiment),
        _conditioning(experiment),
        _validation(experiment, facts),
    )


def _stiffness(experiment: Experiment, facts: Facts) -> Shown:
    about, constants = "stiffness and its growth with depth", ("m", "b")
    readings = sum(move.readings for move in facts.moves if move.kind == "ramp")
    levels = apart(facts.levels, DEEPER)
    noise, units = noise_of(experiment), experiment.units
    ratio = experiment.peak / noise if noise > 0.0 else np.inf
    deep = f"{plain(experiment.depth)} {units.displacement}".removesuffix(" 1")
    clear = f"up to {deep}"
    if experiment.floor.testable:  # else nobody knows the noise so well
        clear += f"; the largest {units.force_name} is {plain(ratio, 2)} times the noise"
    if experiment.floor.testable and ratio < _CLEAR:
        return Shown(
            about, "hardly", clear, "press deeper, or use a load cell of a smaller range", constants
        )
    if readings >= _FEWEST:
        return Shown(about, "yes", f"{readings} readings on the way in, {clear}", "", constants)
    if len(levels) >= 3:
        return Shown(about, "yes", f"holds at {len(levels)} depths, {clear}", "", constants)
    those = f"{readings or 'no'} reading{'' if readings == 1 else 's'}"
    remedy = "record the way in more often, or hold at three depths"
    return Shown(about, "hardly", f"{those} on the way in: a curve needs more", remedy, constants)


def _relaxation(experiment: Experiment, facts: Facts) -> Shown:
    about, constants = "relaxation", ("c", "v")
    quick, slow = facts.durations
    shortest = max(facts.interval, _LEFT * quick)
    longest = max(facts.longest_hold, slow)
    if not facts.holds:
        return _without_holds(facts, about, constants)
    sampled = facts.interval > _LEFT * facts.durations[0]
    bound = "the interval between readings" if sampled else "a tenth of the quickest movement"
    window = f"times from {span(shortest)} ({bound}) to {span(longest)}"
    longer = facts.longest_hold >= slow
    window += " (the longest hold)" if longer else " (the longest movement; no hold is as long)"
    if longest < _WIDE * shortest:
        remedy = "hold longer, or press faster"
        return Shown(about, "hardly", f"{window}: hardly any range", remedy, constants)
    modes = max(1, floor(log10(longest / shortest)))
    many = "one relaxation time" if modes == 1 else f"up to {modes} relaxation times"
    reason = f"{window}: {many}, about one a decade"
    long = [hold for hold in facts.holds if _ALIKE * hold.duration > facts.longest_hold]
    moving = max(long, key=lambda hold: abs(hold.change))  # in its second half
    if abs(moving.change) < _STILL:
        return Shown(about, "yes", reason, "", constants)
    units = experiment.units
    name = units.displacement_name if moving.control == Control.FORCE else units.force_name
    reason += (
        f"; in the second half of the longest hold the {name} still changes by "
        f"{100.0 * abs(moving.change):.2g} % of the largest"
    )
    return Shown(about, "yes", reason, "slower relaxation needs a longer hold", constants)


def _without_holds(facts: Facts, about: str, constants: tuple[str, ...]) -> Shown:
    quick, slow = facts.durations
    speeds = apart(facts.speeds, _FASTER)
    remedy = "hold at depth, as long as the slowest relaxation that matters"
    if len(facts.moves) > 2 or len(speeds) > 1:
        several = "the movements alone" if len(speeds) < 2 else "different speeds alone"
        longest = f"times up to {span(max(slow, quick))} (the longest movement)"
        return Shown(about, "hardly", f"no hold: by {several}, {longest}", remedy, constants)
    reason = "no hold and one speed: relaxation and stiffness cannot be distinguished"
    return Shown(about, "no", reason, remedy, constants)


def _speed(experiment: Experiment, facts: Facts) -> Shown:
    about, unit = "a force that grows with speed", experiment.units.speed
    if not any(trial.trajectory.velocity_resolved for trial in experiment.trials):
        reason = "the displacement records do not give the speed"
        return Shown(about, "no", reason, "record more often", effects=OF_SPEED)
    speeds = apart(facts.speeds, _FASTER)
    if not speeds:
        reason = "no test moves from one position to another"
        return Shown(about, "hardly", reason, "press at two speeds", effects=OF_SPEED)
    if len(speeds) == 1:
        reason = f"one speed, {rated(speeds[0], unit)}, at which it looks like quick relaxation"
        remedy = f"press at another speed, {plain(_FASTER)} times as fast or more"
        return Shown(about, "hardly", reason, remedy, effects=OF_SPEED)
    low, high = rated(speeds[0], unit), rated(max(facts.speeds), unit)
    return Shown(about, "yes", f"speeds from {low} to {high}", effects=OF_SPEED)


def _depth(experiment: Experiment, facts: Facts) -> tuple[Shown, ...]:
    speed, share = "a relaxation whose speed changes with depth", "one whose share does"
    levels = apart(facts.levels, DEEPER)
    rates, strengths = OF_DEPTH[:1], OF_DEPTH[1:]
    if len(levels) > 1:
        about, reason = "relaxation that changes with depth", _levels(experiment, facts, levels)
        return (Shown(about, "yes", f"holds at {reason}", effects=OF_DEPTH),)
    what = "force" if facts.held == Control.FORCE else "depth"
    where = f"one {what}, {_levels(experiment, facts, levels)}" if levels else "no depth"
    reason, remedy = f"holds at {where}", "hold at two depths or more"
    moving = f"{reason}: only the movements could show it"
    one = at_one_depth(experiment)
    return (
        Shown(speed, "hardly", moving, remedy, effects=rates),
        Shown(share, "no" if one else "hardly", reason if one else moving, remedy, (), strengths),
    )


def _levels(experiment: Experiment, facts: Facts, levels: Sequence[float]) -> str:
    units = experiment.units
    unit = units.force if facts.held == Control.FORCE else units.displacement
    named = [plain(level) for level in levels]
    if len(named) > _NAMED:
        named = [*named[: _NAMED - 1], f"{len(named) - _NAMED + 1} more"]
    return f"{joined(named)} {unit}".removesuffix(" 1")


def _unloading(experiment: Experiment, *, bonded: bool) -> Shown:
    about = "softening and a set that stays"
    effects = (*OF_UNLOADING, *(OF_SLIDING if bonded else ()))  # a loose specimen does not slide
    if unloads(experiment) and loaded_once(experiment):
        reason = "one test, no load of which goes deeper than the first: they look much alike"
        remedy = "press a fresh specimen in steps, back after each, to growing depths"
        return Shown(about, "hardly", reason, remedy, effects=effects)
    if unloads(experiment):
        return Shown(about, "yes", "the platen moves back in a test", effects=effects)
    return Shown(about, "no", "no test unloads", "move back in a test", effects=effects)


def _retraction(experiment: Experiment, *, bonded: bool) -> Shown:
    about = "adhesion"
    if bonded:
        return Shown(about, "no", "the specimen is fixed to the platen", effects=OF_RETRACTION)
    if returns(experiment):
        reason = "a test comes back to zero depth or to no force"
        return Shown(about, "yes", reason, effects=OF_RETRACTION)
    reason, remedy = "no test retracts to zero depth", "move back all the way"
    return Shown(about, "no", reason, remedy, effects=OF_RETRACTION)


def _acceleration(experiment: Experiment) -> Shown:
    about = "inertia"
    if any(trial.trajectory.acceleration_resolved for trial in experiment.trials):
        return Shown(about, "yes", "the acceleration is resolved", effects=OF_ACCELERATION)
    remedy = "record more often while the platen starts and stops"
    return Shown(about, "no", "no acceleration is resolved", remedy, effects=OF_ACCELERATION)


def _ringing(experiment: Experiment) -> Shown:
    about, interval = "ringing after a stop", experiment.interval
    remedy = "record more often while the platen starts and stops"
    if not any(trial.trajectory.velocity_resolved for trial in experiment.trials):
        return Shown(about, "no", "no velocity is resolved", remedy, effects=OF_STOPS)
    if READINGS_A_PERIOD * SLOWEST_HZ * interval > 1.0:
        reason = f"readings are {plain(interval, 2)} s apart, and frames swing quicker"
        return Shown(about, "no", reason, remedy, effects=OF_STOPS)
    return Shown(
        about, "yes", f"up to {plain(1.0 / (READINGS_A_PERIOD * interval), 2)} Hz", effects=OF_STOPS
    )


def _clock(experiment: Experiment) -> Shown:
    about, effects = "a change with the clock", OF_THE_CLOCK
    count = len(experiment.trials)
    if count == 1:
        reason = "one test, in which it looks like slow relaxation"
        return Shown(about, "hardly", reason, "repeat the first test last", effects=effects)
    if all(trial.test.start_known for trial in experiment.trials):
        return Shown(about, "yes", f"{count} tests, and the clock between them", effects=effects)
    reason = f"{count} tests, but the file does not say when each began (no column start_s)"
    remedy = "write start_s; until then tests follow one another without a pause"
    return Shown(about, "hardly", reason, remedy, effects=effects)


def _conditioning(experiment: Experiment) -> Shown:
    about, count = "conditioning, from test to test", len(experiment.trials)
    if count == 1:
        return Shown(about, "no", "there is only one test", "repeat it", effects=OF_TESTS)
    return Shown(about, "yes", f"{count} tests, one after the other", effects=OF_TESTS)


def _validation(experiment: Experiment, facts: Facts) -> Shown:
    about = "prediction of unseen tests"
    fitted, others = len(experiment.with_role("fit")), len(experiment.with_role("validate"))
    if fitted and others:
        plural = "s" if others > 1 else ""
        names = joined([trial.name for trial in experiment.with_role("fit")][:_NAMED])
        reason = f"{others} test{plural} can be predicted from {names}"
        return Shown(about, "yes", reason)
    if len(experiment.trials) > 1:
        return Shown(about, "hardly", "every test has the role fit", "give one the role validate")
    what = "one test"
    if facts.loads <= 1:
        what += " with one load: its constants can be fitted, but few effects can be named"
        return Shown(about, "no", what, "press again, at another speed or to another depth")
    return Shown(about, "no", f"{what}: nothing is left to predict", "press again in another test")


def shown_between(pads: Sequence[PadSeen], units: UnitSystem) -> tuple[Shown, ...]:
    """Return whether constants of pads can be compared: tested with similar holds and depths."""
    if len(pads) < 2:
        return ()
    holds = {pad.pad: _longest_hold(pad) for pad in pads}
    depths = {pad.pad: max(test.depth for test in pad.tests) for pad in pads}
    answers = []
    for about, values, most, unit in (
        ("relaxation of the pads, side by side", holds, _ALIKE, "s"),
        ("stiffness of the pads, side by side", depths, DEEPER, units.displacement),
    ):
        low, high = min(values, key=values.__getitem__), max(values, key=values.__getitem__)
        some = f"{plain(values[low])} {unit}".removesuffix(" 1")
        most_of = f"{plain(values[high])} {unit}".removesuffix(" 1")
        what = "held for" if unit == "s" else "pressed to"
        if values[low] > 0.0 and values[high] <= most * values[low]:
            reason = f"all are {what} {some} to {most_of}" if some != most_of else (
                f"all are {what} {some}"
            )  # fmt: skip
            answers.append(Shown(about, "yes", reason))
            continue
        reason = f"pad {low} is {what} {some}, pad {high} {most_of}"
        answers.append(Shown(about, "hardly", reason, "test both alike"))
    return tuple(answers)


def _longest_hold(pad: PadSeen) -> float:
    dwells = [
        phase.stop - phase.start
        for test in pad.tests
        for before, phase in pairwise((None, *test.phases))
        if phase is not None and phase.phase == "hold" and before is not None
    ]
    return max(dwells, default=0.0)


def apart(values: Sequence[float], factor: float) -> list[float]:
    """Return the smallest value, and each that is at least ``factor`` times the one before it."""
    distinct: list[float] = []
    for value in sorted(abs(value) for value in values):
        if value > 0.0 and (not distinct or value >= factor * distinct[-1]):
            distinct.append(value)
    return distinct
