r"""Load-controlled tests: the displacement under a prescribed force, by differential equations.

With the force prescribed, the pad's equations give its speed (shares c sum to one),

.. math:: \dot\delta = \frac{\dot F + \sum_i c_i v_i q_i}{K(\delta)}, \quad
          \dot q_i = K(\delta) \dot\delta - v_i q_i,

which classical Runge-Kutta steps solve from sample to sample. A force that jumps moves the pad at
once along its elastic curve.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import log1p

import numpy as np
from numpy.typing import NDArray

from qlvbayes.io.checks import InputError

from .constants import Constants
from .rig import PAUSE_S, SAMPLE_RATE, Record, SimulatedTest, stream
from .sensors import Noise, encode, thin

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Load:
    """Change of the force to a value (N) within a time (s; 0: at once), then a hold (s)."""

    force: float
    within: float
    hold: float


def creep_protocol(load: float) -> tuple[Load, ...]:
    """Return a load programme: to `load` (N) in 0.1 s, 30 s; back to 30 % in 0.3 s, 30 s."""
    return Load(load, 0.1, 30.0), Load(0.3 * load, 0.3, 30.0)


def prescribed(program: Iterable[Load], sample_rate: float = SAMPLE_RATE) -> tuple[Array, Array]:
    """Return times (s) and forces (N), both (n,), of a program sampled evenly."""
    corners, forces = [0.0], [0.0]
    for load in program:
        if not (load.force > 0.0 and load.within >= 0.0 and load.hold > 0.0):
            raise InputError(f"forces and times must be above 0, not {load}")
        corners += [corners[-1] + load.within, corners[-1] + load.within + load.hold]
        forces += [load.force, load.force]
    time = np.arange(int(corners[-1] * sample_rate + 1e-6) + 1) / sample_rate
    index = np.clip(np.searchsorted(corners, time, side="right") - 1, 0, len(corners) - 2)
    start, stop = np.array(corners)[index], np.array(corners)[index + 1]
    share = np.clip((time - start) / np.where(stop > start, stop - start, 1.0), 0.0, 1.0)
    return time, (1.0 - share) * np.array(forces)[index] + share * np.array(forces)[index + 1]


def displacement_under(constants: Constants, time: Array, force: Array) -> Array:
    """Return the displacement (n,) in mm under a force (n,) in N, linear between times (n,)."""
    if np.min(force) < 0.0:
        raise InputError("a prescribed force must not be below 0")
    m, b = constants.m, constants.b
    modes = list(zip(constants.c[1:], constants.v, strict=True))
    # the elastic force stands for the displacement: its rate is K d'
    state = [float(force[0])] * (1 + len(modes))

    def slope(rate: float, state: Sequence[float]) -> list[float]:
        flow = rate + sum(c * v * q for (c, v), q in zip(modes, state[1:], strict=True))
        return [flow, *(flow - v * q for (_, v), q in zip(modes, state[1:], strict=True))]

    elastic = [state[0]]
    for width, change in zip(np.diff(time).tolist(), np.diff(force).tolist(), strict=True):
        state = runge_kutta(slope, change / width, state, width)
        elastic.append(state[0])
    return np.array([log1p(b * x / m) / b for x in elastic])


Slope = Callable[[float, Sequence[float]], list[float]]


def runge_kutta(slope: Slope, rate: float, state: Sequence[float], h: float) -> list[float]:
    """Return the state after a step h (s) in which what is prescribed changes at an even rate."""
    one = slope(rate, state)
    two = slope(rate, [x + 0.5 * h * k for x, k in zip(state, one, strict=True)])
    three = slope(rate, [x + 0.5 * h * k for x, k in zip(state, two, strict=True)])
    four = slope(rate, [x + h * k for x, k in zip(state, three, strict=True)])
    return [
        x + h * (a + 2.0 * (p + q) + d) / 6.0
        for x, a, p, q, d in zip(state, one, two, three, four, strict=True)
    ]


def record_creep(
    constants: Constants,
    program: Iterable[Load],
    noise: Noise,
    rng: np.random.Generator,
    sample_rate: float = SAMPLE_RATE,
    max_rows: int | None = None,
    closed_loop: bool = False,
) -> Record:
    """Run one load-controlled test."""
    time, wanted = prescribed(program, sample_rate)
    errors, force = noise.draw(time, rng), wanted
    if closed_loop:
        slow = Noise(0.0, noise.correlated, noise.correlation_time).draw(time, rng)
        errors = Noise(noise.white, 0.0).draw(time, rng)
        force = np.maximum(wanted - slow * (wanted > 0.0), 0.0)
        errors = errors + (wanted - force)
    displacement = displacement_under(constants, time, force)
    kept = slice(None) if max_rows is None else thin(time, wanted, max_rows)
    columns = (time, encode(displacement), force + errors, displacement, force)
    return Record(*(column[kept] for column in columns))


def creep_study(
    pads: Mapping[str, Constants],
    loads: Sequence[float],
    noise: Noise,
    seed: int,
    max_rows: int | None = None,
    clocks: Mapping[str, float] | None = None,
) -> list[SimulatedTest]:
    """Simulate a creep test at each load (N) on each pad, with 120 s of rest in between."""
    tests = []
    for pad, constants in pads.items():
        clock = (clocks or {}).get(pad, 0.0)
        for load in loads:
            name = f"{pad}-{load:g}N"
            record = record_creep(
                constants, creep_protocol(load), noise, stream(seed, name), max_rows=max_rows
            )
            tests.append(SimulatedTest(pad, name, clock, record, "force"))
            clock += float(record.time[-1]) + PAUSE_S
    return tests
