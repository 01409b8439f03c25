r"""Tests whose control changes: paused under a force, or held and then recovered at no force.

The pad's equations, with shares c that sum to one and K = m + b e (e: the elastic force),

.. math:: \dot q_i = \dot e - v_i q_i, \quad F = \sum_i c_i q_i, \quad q_0 = e,

are solved from sample to sample by classical Runge-Kutta steps: where the displacement is
prescribed by :math:`\dot e = K \dot\delta`, where the force is by
:math:`\dot e = \dot F + \sum_i c_i v_i q_i`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from math import ceil, inf, log1p

import numpy as np
from numpy.typing import NDArray

from qlvbayes.io.checks import InputError
from qlvbayes.simulate.constants import Constants
from qlvbayes.simulate.creep import Load, runge_kutta
from qlvbayes.simulate.platen import Hold, Move
from qlvbayes.simulate.rig import SAMPLE_RATE, Record
from qlvbayes.simulate.sensors import Noise, encode

Array = NDArray[np.float64]

_LONGEST = 1_000_000  # samples, in which a force must be reached


@dataclass(frozen=True)
class Press:
    """Movement inwards at an even speed (mm/s) until a force (N) is reached."""

    force: float
    speed: float

    def __post_init__(self) -> None:
        if not (0.0 < self.force < inf and 0.0 < self.speed < inf):
            raise InputError(f"a force to reach and its speed must be above 0, not {self}")


Controlled = Move | Hold | Press | Load


def press_and_pause(force: float, speed: float, pause: float) -> tuple[Controlled, ...]:
    """Return a programme: move to a force (N), pause under it (s), move back to 0."""
    return Press(force, speed), Load(force, 0.0, pause), Move(0.0, speed)


def hold_and_recover(depth: float, speed: float, hold: float) -> tuple[Controlled, ...]:
    """Return a programme: move to a depth (mm), hold it (s), recover at no force as long."""
    return Move(depth, speed), Hold(hold), Load(0.0, 0.2, hold)


def record_controlled(
    constants: Constants,
    program: Iterable[Controlled],
    noise: Noise,
    rng: np.random.Generator,
    sample_rate: float = SAMPLE_RATE,
    closed_loop: bool = False,
) -> tuple[Record, NDArray[np.bool_]]:
    """Run one test; return it, and (n,) at which samples the force was prescribed."""
    program = tuple(program)
    still = _ControlledRun(constants, 1.0 / sample_rate, None)
    for step in program:
        still.do(step)
    # a controller may reach a force some samples later
    time = np.arange(2 * len(still.force)) / sample_rate
    slow = Noise(0.0, noise.correlated, noise.correlation_time).draw(time, rng)
    white = Noise(noise.white, 0.0).draw(time, rng)
    run = still
    if closed_loop:
        run = _ControlledRun(constants, 1.0 / sample_rate, slow)
        for step in program:
            run.do(step)
    force, displacement = np.array(run.force), np.array(run.displacement)
    read = force + (slow + white)[: force.size]
    record = Record(time[: force.size], encode(displacement), read, displacement, force)
    return record, np.array(run.loaded)


@dataclass
class _ControlledRun:
    """A pad on its way through a programme, with all samples so far."""

    constants: Constants
    step: float
    slow: Array | None
    state: list[float] = field(init=False)
    displacement: list[float] = field(default_factory=lambda: [0.0])
    force: list[float] = field(default_factory=lambda: [0.0])
    loaded: list[bool] = field(default_factory=lambda: [False])

    def __post_init__(self) -> None:
        self.state = [0.0] * len(self.constants.c)

    def do(self, step: Controlled) -> None:
        """Go through one step of the programme; its duration is rounded up to whole samples."""
        if isinstance(step, Press):
            self._press(step)
        elif isinstance(step, Hold):
            for _ in range(self._samples(step.seconds)):
                self._move(0.0)
        elif isinstance(step, Move):
            way = step.target - self.displacement[-1]
            count = self._samples(abs(way) / step.speed)
            for _ in range(count):
                self._move(way / (count * self.step))
        else:
            begin, count = self.force[-1], self._samples(step.within)
            for k in range(count):
                self._load(begin + (step.force - begin) * (k + 1) / count)
            for _ in range(self._samples(step.hold)):
                self._load(step.force)

    def _press(self, step: Press) -> None:
        """Move in until the force is reached, to which the last sample is brought."""
        while True:
            before = self.state
            self._move(step.speed)
            if self.force[-1] >= step.force:
                break
            if len(self.force) > _LONGEST:
                raise InputError(f"{step} is not reached in {_LONGEST} samples")
        reached, begun = self.force[-1], self.force[-2]
        for values in (self.displacement, self.force, self.loaded):
            values.pop()
        self.state = before
        self._move(step.speed * (step.force - begun) / (reached - begun))

    def _samples(self, seconds: float) -> int:
        return max(ceil(seconds / self.step - 1e-9), 1)

    def _move(self, speed: float) -> None:
        m, b, v = self.constants.m, self.constants.b, self.constants.v

        def slope(speed: float, state: Sequence[float]) -> list[float]:
            flow = (m + b * state[0]) * speed
            return [flow, *(flow - x * q for x, q in zip(v, state[1:], strict=True))]

        self.state = runge_kutta(slope, speed, self.state, self.step)
        self._sample(loaded=False)

    def _load(self, wanted: float) -> None:
        """Bring the force to a value, as far as the controller's load cell shows it."""
        goal = wanted
        if self.slow is not None:
            goal = max(wanted - float(self.slow[len(self.force)]), 0.0)
        modes = list(zip(self.constants.c[1:], self.constants.v, strict=True))

        def slope(rate: float, state: Sequence[float]) -> list[float]:
            flow = rate + sum(c * v * q for (c, v), q in zip(modes, state[1:], strict=True))
            return [flow, *(flow - v * q for (_, v), q in zip(modes, state[1:], strict=True))]

        rate = (goal - self._superposed) / self.step
        self.state = runge_kutta(slope, rate, self.state, self.step)
        self._sample(loaded=True)

    @property
    def _superposed(self) -> float:
        """Force of the modes (N); below 0 the pad has left the platen."""
        return sum(c * q for c, q in zip(self.constants.c, self.state, strict=True))

    def _sample(self, *, loaded: bool) -> None:
        m, b = self.constants.m, self.constants.b
        self.displacement.append(log1p(b * self.state[0] / m) / b)
        self.force.append(max(self._superposed, 0.0))
        self.loaded.append(loaded)
