"""Quantities derived from a model, and where they are read: inside what both pads' tests cover.

They are stiffness, forces, times, lost energy and loss tangent.

Every number comes from `Model.force` of a motion, so that effects take part in it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import jax
import numpy as np

from qlvbayes.comparison.contrast import ReadAt
from qlvbayes.inference.forward.forces import Forces
from qlvbayes.io.checks import InputError
from qlvbayes.io.units import UnitSystem
from qlvbayes.laws.motion import Motion
from qlvbayes.model.model import Model
from qlvbayes.motion.facts import Covered
from qlvbayes.motion.record import Blocks, Record, held

_ROUND = (1.0, 1.5, 2.0, 3.0, 5.0, 7.0)
_UNKNOWN = Covered(depth=1.0, slowest=0.1, fastest=10.0, quickest=0.1, hold=30.0, tests=0)
_STEP = 0.1  # of the hold: a ramp that takes less is over when the hold is
_NEAR = 1.05  # of a range, that still counts as inside it


@dataclass(frozen=True)
class ReadingSettings:
    """Values at which quantities are read, as in `ReadAt`, and what all tests cover, if known."""

    depth: float
    rates: tuple[float, ...]
    frequencies: tuple[float, ...]
    hold: float
    reach: Covered | None

    @property
    def after(self) -> float:
        """Round time (s) within which every pad was held."""
        return _round_below(self.hold)

    @property
    def relaxes_further(self) -> bool:
        """True if a step and the whole hold leave another force than the fastest ramp and `after`.

        One number would be told twice where both times are one and the ramp is a step beside them.
        """
        ramp = self.depth / max(self.rates)
        return self.hold > self.after or ramp > _STEP * self.hold

    def beyond(self, rate: float | None = None, frequency: float | None = None) -> bool:
        """Return whether the depth, a speed or a frequency is beyond a pad's tests."""
        reach = self.reach
        if reach is None:
            return False
        ranges = [(self.depth, 0.0, reach.depth)]
        ranges += [] if rate is None else [(rate, reach.slowest, reach.fastest)]
        ranges += [] if frequency is None else [(frequency, *_band(reach))]
        return not all(low / _NEAR <= value <= _NEAR * high for value, low, high in ranges)

    @property
    def as_record(self) -> ReadAt:
        """The settings as the comparison's record stores them."""
        return ReadAt(self.depth, self.rates, self.frequencies, self.hold)


def choose(
    reaches: Sequence[Covered | None],
    depth: float | None = None,
    rates: Sequence[float] | None = None,
    frequencies: Sequence[float] | None = None,
) -> ReadingSettings:
    """Return what was asked for, else a depth, three speeds and frequencies inside all tests."""
    asked = {"depth": [] if depth is None else [depth], "rate": rates, "frequency": frequencies}
    for what, values in asked.items():
        for number in values or ():
            if not (math.isfinite(number) and number > 0.0):
                raise InputError(f"{what} {number:g} is not above 0", remedy="give a positive one")
    known = [asdict(reach) for reach in reaches if reach is not None]
    ends = {"slowest": max, "quickest": max}  # of what all cover; of everything else the least
    common = (
        Covered(**{key: ends.get(key, min)(one[key] for one in known) for key in known[0]})
        if known
        else None
    )
    reach = common or _UNKNOWN
    series = _series(reach.slowest, reach.fastest)
    return ReadingSettings(
        depth=_round_below(reach.depth) if depth is None else float(depth),
        rates=tuple(map(float, rates or sorted({series[0], series[len(series) // 2], series[-1]}))),
        frequencies=tuple(map(float, frequencies or _series(*_band(reach)))),
        hold=float(f"{reach.hold:.2g}"),
        reach=common,
    )


def _band(reach: Covered) -> tuple[float, float]:
    """Return the frequencies (Hz) between which tests show a response."""
    return 1.0 / reach.hold, 0.25 / reach.quickest


def _round_below(value: float) -> float:
    """Return the largest round number that is not above ``value``."""
    power = 10.0 ** math.floor(math.log10(value))
    return max(r * power for r in _ROUND if r * power <= value * (1.0 + 1e-6))


def _series(low: float, high: float) -> list[float]:
    """Return 1, 3, 10, 30, ... inside a range, or its middle if there is none."""
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    steps = [float(f"{r}e{k}") for k in decades for r in (1, 3)]
    inside = [x for x in steps if low / _NEAR <= x <= high * _NEAR]
    return inside or [float(f"{math.sqrt(low * high):.2g}")]


RAMP_POINTS = 129
HOLD_POINTS = 193
_DECADES = 6  # that the points of a hold span

CYCLES, REST_CYCLES = 3, 1
PIECES = 96  # of a cycle
AMPLITUDE = 0.01  # of a small oscillation, over the depth

_INSTANT = 1e-6  # s, in which a step is made


@dataclass(frozen=True, eq=False)
class Course:
    """A motion (N,): time (s), depth (mm) and velocity (mm/s) just after each point."""

    time: np.ndarray
    depth: np.ndarray
    velocity: np.ndarray


def ramp_hold(depth: float, speed: float, duration: float) -> Course:
    """Return a ramp from contact to ``depth`` (mm) at ``speed`` (mm/s), then rest (s)."""
    up = ramp(0.0, 0.0, depth, speed)
    return joined([up, hold(up.time[-1], depth, duration)])


def oscillation(
    depth: float, speed: float, duration: float, frequency: float, amplitude: float
) -> Course:
    """Return a ramp, a hold and a burst of a sine (Hz) about ``depth`` in a Hann window."""
    before = ramp_hold(depth, speed, duration)
    phase = np.linspace(0.0, CYCLES + REST_CYCLES, (CYCLES + REST_CYCLES) * PIECES + 1)  # cycles
    window = np.where(phase <= CYCLES, np.sin(np.pi * phase / CYCLES) ** 2, 0.0)
    swing = amplitude * window * np.sin(2.0 * np.pi * phase)
    speeds = np.diff(swing, append=swing[-1]) * PIECES * frequency
    time = before.time[-1] + _with_middles(phase) / frequency
    burst = Course(time, depth + _with_middles(swing), np.repeat(speeds, 2)[:-1])
    return joined([before, burst])


def _with_middles(ends: np.ndarray) -> np.ndarray:
    both = np.empty(2 * ends.size - 1)
    both[::2], both[1::2] = ends, 0.5 * (ends[1:] + ends[:-1])
    return both


def ramp(start: float, first: float, last: float, speed: float) -> Course:
    """Return a ramp that begins at ``start`` (s), from one depth to another."""
    share = np.linspace(0.0, 1.0, RAMP_POINTS)
    travel = last - first
    velocity = np.full(RAMP_POINTS, np.sign(travel) * speed)
    return Course(start + share * abs(travel) / speed, first + share * travel, velocity)


def hold(start: float, depth: float, duration: float) -> Course:
    """Return a hold whose points are even in the logarithm of time."""
    shares = np.concatenate([[0.0], np.geomspace(10.0**-_DECADES, 1.0, HOLD_POINTS - 1)])
    nothing = np.zeros(HOLD_POINTS)
    return Course(start + duration * shares, nothing + depth, nothing)


def joined(parts: Sequence[Course]) -> Course:
    """Join motions; at a kink both velocities are there, at the same time."""
    return Course(
        np.concatenate([part.time for part in parts]),
        np.concatenate([part.depth for part in parts]),
        np.concatenate([part.velocity for part in parts]),
    )


_CLOSE = 1e-4  # of the depth, between the forces whose slope is the stiffness
_ENGINE = Forces()


@dataclass(frozen=True)
class Reading:
    """A derived quantity: name, unit, kind, and whether it is extrapolated."""

    quantity: str
    unit: str
    group: str
    extrapolated: bool
    # whether ramps and holds of all tests show it themselves, whatever the model
    shown: bool = False


def readings(settings: ReadingSettings, units: UnitSystem) -> list[Reading]:
    """Return the quantities, in the order of `read`.

    instantaneous stiffness: slope of the force just after steps to about the depth; relaxed: after
    the hold; peak force: largest in a ramp to the depth; relaxed force: after a step and the hold,
    unless this is the force after a time (below);
    half-relaxation time: in a hold after the fastest ramp, until half of what the force loses in it
    is lost; force after, share lost: in a time of such a hold for which every pad was held, of the
    force when it began; lost energy: the loop of force over depth, to the depth and back at one
    speed; loss tangent: lost over stored part of the response to oscillations of 1 % about the
    depth, after the hold.
    """
    depth = f"{settings.depth:g} {units.displacement}"
    depth = f"strain {settings.depth:g}" if units.dimensionless else depth
    per = "/s" if units.dimensionless else f" {units.speed}"
    held = f"{settings.after:g} s of a hold at {depth}"
    force, deep = units.force_name, settings.beyond()
    rates = [(f"{rate:g}{per}", settings.beyond(rate)) for rate in settings.rates]
    far = settings.beyond(max(settings.rates))
    relaxed = Reading(f"relaxed {force} at {depth}", units.force, "force", deep)
    return [
        Reading(f"instantaneous stiffness at {depth}", units.stiffness, "stiffness", deep),
        Reading(f"relaxed stiffness at {depth}", units.stiffness, "stiffness", deep),
        *(Reading(f"peak {force} at {r}", units.force, "force", x, not x) for r, x in rates),
        *([relaxed] if settings.relaxes_further else []),
        Reading(f"{force} after {held}", units.force, "force", far, not far),
        Reading(f"half-relaxation time at {depth}", "s", "relaxation", deep),
        Reading(f"share lost in {held}", "1", "relaxation", far, not far),
        *(Reading(f"energy lost in a cycle at {r}", units.energy, "energy", x) for r, x in rates),
        *(
            Reading(
                f"loss tangent at {f:g} Hz about {depth}",
                "1",
                "loss tangent",
                settings.beyond(frequency=f),
            )
            for f in settings.frequencies
        ),
    ]


def read(models: Model, settings: ReadingSettings) -> np.ndarray:
    """Return the quantities (n, Q) of `readings` for n models, along their leading axis."""
    depth, rest = settings.depth, settings.hold
    fastest = max(settings.rates)
    instant, relaxed, force = _stiffness(models, depth, rest)
    loops = []
    for rate in settings.rates:
        up = ramp(0.0, 0.0, depth, rate)
        both = joined([up, ramp(up.time[-1], depth, 0.0, rate)])
        loops.append((both, forces(models, both)))
    course = ramp_hold(depth, fastest, rest)
    held = forces(models, course)[:, RAMP_POINTS:]
    clock = course.time[RAMP_POINTS:] - course.time[RAMP_POINTS]
    after = np.array([np.interp(settings.after, clock, one) for one in held])
    columns = [
        instant,
        relaxed,
        *(loop[:, :RAMP_POINTS].max(axis=1) for _, loop in loops),
        *([force] if settings.relaxes_further else []),
        after,
        _half_time(held, clock),
        1.0 - after / held[:, 0],
        *(np.trapezoid(loop, both.depth) for both, loop in loops),
        *(_loss_tangent(models, depth, fastest, rest, f) for f in settings.frequencies),
    ]
    return np.stack(columns, axis=-1)


def forces(models: Model, course: Course) -> np.ndarray:
    """Return the force (n, N) of each model at the points of a motion."""
    count = len(jax.tree.leaves(models)[0])
    sets = jax.tree.map(lambda leaf: np.moveaxis(np.asarray(leaf), 0, -1), models)
    still, time = np.zeros(course.time.size), course.time
    motion = Motion(*map(held, (time, course.depth, course.velocity, still)))
    nodes = held(np.stack(2 * [np.arange(time.size)], axis=-1))  # each block is one point
    alone = Record(motion, nodes, Blocks.of_means(still, still + 1.0, time, time))
    record = jax.tree.map(lambda leaf: np.asarray(leaf)[None], alone)
    return _ENGINE.over(sets, count, record)[:, 0]


def _stiffness(
    models: Model, depth: float, rest: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return instantaneous and relaxed slope of the force after a step, and relaxed force."""
    after = [RAMP_POINTS, -1]  # just after the step, after the hold
    depths = [depth * (1.0 + x) for x in (-_CLOSE, _CLOSE)]
    steps = [ramp_hold(one, one / _INSTANT, rest) for one in depths]
    less, more = (forces(models, step)[:, after] for step in steps)
    slopes = (more - less) / (2.0 * _CLOSE * depth)
    return slopes[:, 0], slopes[:, 1], 0.5 * (more + less)[:, 1]


def _half_time(force: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Return the time in a hold (N,) at which forces (n, N) have lost half of their loss."""
    half = 0.5 * (force[:, 0] + force[:, -1])
    after = np.maximum(np.argmax(force <= half[:, None], axis=1), 1)
    rows = np.arange(len(force))
    above, below = force[rows, after - 1], force[rows, after]
    with np.errstate(divide="ignore", invalid="ignore"):  # nothing relaxes: not a number
        share = (above - half) / (above - below)
    return time[after - 1] + share * (time[after] - time[after - 1])


def _loss_tangent(
    models: Model, depth: float, rate: float, rest: float, frequency: float
) -> np.ndarray:
    """Return the loss tangent from half the difference of two opposite oscillations."""
    size = AMPLITUDE * depth
    up, down = (oscillation(depth, rate, rest, frequency, s) for s in (size, -size))
    middles = slice(RAMP_POINTS + HOLD_POINTS + 1, None, 2)  # of the burst's pieces
    swing = (forces(models, up) - forces(models, down))[:, middles]
    moved = (up.depth - down.depth)[middles]
    wave = np.exp(-2j * np.pi * frequency * up.time[middles])
    modulus = (swing @ wave) / (moved @ wave)
    with np.errstate(invalid="ignore"):  # no force is left to oscillate: not a number
        loss: np.ndarray = modulus.imag / modulus.real
    return loss
