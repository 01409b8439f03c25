r"""Tests whose control changes: paused under a force, or held and then recovered at no force.

The pad's equations, with shares c that sum to one and K = m + b e (e: the elastic force),

.. math:: \dot q_i = \dot e - v_i q_i, \quad F = \sum_i c_i q_i, \quad q_0 = e,

are solved from sample to sample by classical Runge-Kutta steps: where the displacement is
prescribed by :math:`\dot e = K \dot\delta`, where the force is by
:math:`\dot e = \dot F + \sum_i c_i v_i q_i`.
"""

from dataclasses import dataclass
from math import ceil, log1p

import numpy as np

from qlvbayes.simulate.creep import Load, runge_kutta
from qlvbayes.simulate.platen import Hold, Move
from qlvbayes.simulate.rig import Record
from qlvbayes.simulate.sensors import Noise, encode

_LONGEST = 1_000_000  # samples, in which a force must be reached


@dataclass(frozen=True)
class Press:
    """Movement inwards at an even speed (mm/s) until a force (N) is reached."""

    force: float
    speed: float


def press_and_pause(force, speed, pause):
    """Return a programme: move to a force (N), pause under it (s), move back to 0."""
    return Press(force, speed), Load(force, 0.0, pause), Move(0.0, speed)


def hold_and_recover(depth, speed, hold):
    """Return a programme: move to a depth (mm), hold it (s), recover at no force as long."""
    return Move(depth, speed), Hold(hold), Load(0.0, 0.2, hold)


def record_controlled(constants, program, noise, rng, sample_rate, closed_loop=False):
    """Run one test; return it, and (n,) at which samples the force was prescribed."""
    still = _ControlledRun(constants, 1.0 / sample_rate, None)
    still.do(program)
    # a controller may reach a force some samples later
    time = np.arange(2 * len(still.force)) / sample_rate
    slow = Noise(0.0, noise.correlated, noise.correlation_time).draw(time, rng)
    white = Noise(noise.white, 0.0).draw(time, rng)
    run = still
    if closed_loop:
        run = _ControlledRun(constants, 1.0 / sample_rate, slow)
        run.do(program)
    force, displacement = np.array(run.force), np.array(run.displacement)
    read = force + (slow + white)[: force.size]
    record = Record(time[: force.size], encode(displacement), read, displacement, force)
    return record, np.array(run.loaded)


class _ControlledRun:
    """A pad on its way through a programme, with all samples so far."""

    def __init__(self, constants, step, slow):
        self.constants, self.step, self.slow = constants, step, slow
        self.state = [0.0] * len(constants.c)
        self.displacement, self.force, self.loaded = [0.0], [0.0], [False]

    def do(self, program):
        """Go through the steps of a programme; durations are rounded up to whole samples."""
        for step in program:
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

    def _press(self, step):
        """Move in until the force is reached, to which the last sample is brought."""
        while self.force[-1] < step.force:
            before = self.state
            self._move(step.speed)
            assert len(self.force) < _LONGEST
        reached, begun = self.force[-1], self.force[-2]
        for values in (self.displacement, self.force, self.loaded):
            values.pop()
        self.state = before
        self._move(step.speed * (step.force - begun) / (reached - begun))

    def _samples(self, seconds):
        return max(ceil(seconds / self.step - 1e-9), 1)

    def _move(self, speed):
        m, b, v = self.constants.m, self.constants.b, self.constants.v

        def slope(speed, state):
            flow = (m + b * state[0]) * speed
            return [flow, *(flow - x * q for x, q in zip(v, state[1:], strict=True))]

        self.state = runge_kutta(slope, speed, self.state, self.step)
        self._sample(loaded=False)

    def _load(self, wanted):
        """Bring the force to a value, as far as the controller's load cell shows it."""
        goal = wanted
        if self.slow is not None:
            goal = max(wanted - float(self.slow[len(self.force)]), 0.0)
        modes = list(zip(self.constants.c[1:], self.constants.v, strict=True))

        def slope(rate, state):
            flow = rate + sum(c * v * q for (c, v), q in zip(modes, state[1:], strict=True))
            return [flow, *(flow - v * q for (_, v), q in zip(modes, state[1:], strict=True))]

        rate = (goal - self._superposed) / self.step
        self.state = runge_kutta(slope, rate, self.state, self.step)
        self._sample(loaded=True)

    @property
    def _superposed(self):
        """Force of the modes (N); below 0 the pad has left the platen."""
        return sum(c * q for c, q in zip(self.constants.c, self.state, strict=True))

    def _sample(self, *, loaded):
        m, b = self.constants.m, self.constants.b
        self.displacement.append(log1p(b * self.state[0] / m) / b)
        self.force.append(max(self._superposed, 0.0))
        self.loaded.append(loaded)
