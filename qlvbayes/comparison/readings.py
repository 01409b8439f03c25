"""Quantities derived from a model: stiffness, forces, times, lost energy, loss tangent.

Every number comes from `Model.force` of a motion, so that effects take part in it.
"""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from qlvbayes.comparison import programmes
from qlvbayes.comparison.settings import ReadingSettings
from qlvbayes.io.units import UnitSystem
from qlvbayes.laws.motion import Motion
from qlvbayes.model.model import Model

_CLOSE = 1e-4  # of the depth, between the forces whose slope is the stiffness
_BATCH = 256


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
    energy = units.energy
    deep, force = settings.deeper, units.force_name
    quantities = [
        Reading(f"instantaneous stiffness at {depth}", units.stiffness, "stiffness", deep),
        Reading(f"relaxed stiffness at {depth}", units.stiffness, "stiffness", deep),
    ]
    for rate in settings.rates:
        far = deep or settings.outside_rates(rate)
        quantities.append(
            Reading(f"peak {force} at {rate:g}{per}", units.force, "force", far, not far)
        )
    if settings.relaxes_further:
        quantities.append(Reading(f"relaxed {force} at {depth}", units.force, "force", deep))
    held = f"{settings.after:g} s of a hold at {depth}"
    far = deep or settings.outside_rates(max(settings.rates))
    quantities.append(Reading(f"{force} after {held}", units.force, "force", far, not far))
    quantities.append(Reading(f"half-relaxation time at {depth}", "s", "relaxation", deep))
    quantities.append(Reading(f"share lost in {held}", "1", "relaxation", far, not far))
    for rate in settings.rates:
        far = deep or settings.outside_rates(rate)
        quantities.append(
            Reading(f"energy lost in a cycle at {rate:g}{per}", energy, "energy", far)
        )
    for frequency in settings.frequencies:
        far = deep or settings.outside_frequencies(frequency)
        name = f"loss tangent at {frequency:g} Hz about {depth}"
        quantities.append(Reading(name, "1", "loss tangent", far))
    return quantities


def read(models: Model, settings: ReadingSettings) -> np.ndarray:
    """Return the quantities (n, Q) of `readings` for n models, along their leading axis."""
    depth, rest = settings.depth, settings.hold
    fastest = max(settings.rates)
    instant, relaxed, force = _stiffness(models, depth, rest)
    cycles = [programmes.cycle(depth, rate) for rate in settings.rates]
    loops = [(course, forces(models, course)) for course in cycles]
    course = programmes.ramp_hold(depth, fastest, rest)
    held = forces(models, course)[:, programmes.RAMP_POINTS :]
    clock = course.time[programmes.RAMP_POINTS :] - course.time[programmes.RAMP_POINTS]
    after = np.array([np.interp(settings.after, clock, one) for one in held])
    columns = [
        instant,
        relaxed,
        *(loop[:, : programmes.RAMP_POINTS].max(axis=1) for _, loop in loops),
        *([force] if settings.relaxes_further else []),
        after,
        _half_time(held, clock),
        1.0 - after / held[:, 0],
        *(np.trapezoid(loop, course.depth) for course, loop in loops),
        *(_loss_tangent(models, depth, fastest, rest, f) for f in settings.frequencies),
    ]
    return np.stack(columns, axis=-1)


def forces(models: Model, course: programmes.Course) -> np.ndarray:
    """Return the force (n, N) of each model at the points of a motion."""
    full = course.filled()
    rest = np.zeros(programmes.POINTS)
    motion = Motion(*map(jnp.asarray, (full.time, full.depth, full.velocity, rest)))
    count = len(jax.tree.leaves(models)[0])
    parts = []
    for start in range(0, count, _BATCH):
        # the last batch is filled up, so that one compiled function serves any number
        rows = np.minimum(np.arange(start, start + _BATCH), count - 1)
        some = jax.tree.map(lambda x, rows=rows: x[rows], models)
        parts.append(np.asarray(_forces(some, motion)))
    return np.concatenate(parts)[:count, : course.time.size]


@jax.jit
def _forces(models: Model, motion: Motion) -> Array:
    return jax.vmap(lambda model: model.force(motion))(models)


def _stiffness(
    models: Model, depth: float, rest: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return instantaneous and relaxed slope of the force after a step, and relaxed force."""
    after = [programmes.RAMP_POINTS, -1]  # just after the step, after the hold
    less, more = (
        forces(models, programmes.step_hold(depth * (1.0 + x), rest))[:, after]
        for x in (-_CLOSE, _CLOSE)
    )
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
    size = programmes.AMPLITUDE * depth
    up, down = (programmes.oscillation(depth, rate, rest, frequency, s) for s in (size, -size))
    swing = programmes.middles(forces(models, up) - forces(models, down))
    moved = programmes.middles(up.depth - down.depth)
    wave = np.exp(-2j * np.pi * frequency * programmes.middles(up.time))
    modulus = (swing @ wave) / (moved @ wave)
    return modulus.imag / modulus.real
