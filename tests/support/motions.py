"""Motions known in closed form, and loggers that read them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PPoly

LIMIT = 1000.0  # mm/s2
STROKE = 1.6  # mm


class WithJumps:
    """A motion that has ``jumps``, times at which velocity or acceleration jump, and ``at``."""

    def away(self, t, samples, step):
        """(n,) False at the ``samples`` readings on either side of a jump, and until it shows."""
        clear = np.ones(t.size, dtype=bool)
        for jump in self.jumps:
            (_, _), (v0, v1), (a0, a1) = (y for y in self.at(jump + np.array([-1e-7, 1e-7])))
            change = max(abs(v1 - v0), 1e-300), max(abs(a1 - a0), 1e-300)
            shown = min(2.0 * step / change[0], np.sqrt(4.0 * step / change[1]))
            k = np.searchsorted(t, [jump - shown, jump + shown])
            clear[max(k[0] - samples, 0) : k[1] + samples] = False
        return clear


@dataclass(frozen=True)
class Known(WithJumps):
    """Polynomial pieces; ``jumps``: where velocity or acceleration jump."""

    poly: PPoly
    jumps: np.ndarray

    @property
    def duration(self):
        return float(self.poly.x[-1])

    def at(self, t):
        return tuple(np.asarray(self.poly(t, nu)) for nu in (0, 1, 2))


@dataclass(frozen=True)
class Wave(WithJumps):
    """Sums of sines: amplitude, frequency and phase (rad) of each, and a constant."""

    terms: tuple[tuple[float, float, float], ...]
    offset: float
    duration: float
    jumps: np.ndarray

    def at(self, t):
        x, v, a = np.full(t.shape, self.offset), np.zeros(t.shape), np.zeros(t.shape)
        for size, frequency, phase in self.terms:
            w = 2 * np.pi * frequency
            x = x + size * np.sin(w * t + phase)
            v = v + size * w * np.cos(w * t + phase)
            a = a - size * w**2 * np.sin(w * t + phase)
        return x, v, a


@dataclass(frozen=True)
class Bumps(WithJumps):
    """A hand: Gaussian-smooth moves of different size, length and time."""

    moves: tuple[tuple[float, float, float], ...]  # size, time, width
    duration: float
    jumps: np.ndarray

    def at(self, t):
        x, v, a = np.zeros(t.shape), np.zeros(t.shape), np.zeros(t.shape)
        for size, centre, width in self.moves:
            u = (t - centre) / width
            g = size * np.exp(-0.5 * u**2)
            x, v, a = x + g, v - g * u / width, a + g * (u**2 - 1.0) / width**2
        return x, v, a


def constant_jerk(pieces, order):
    """Known from (duration, jerk, velocity or acceleration set anew or None) pieces."""
    knots, rows, x, v, a = [0.0], [], 0.0, 0.0, 0.0
    jumps = []
    for length, jerk, acceleration, velocity in pieces:
        new_a = a if acceleration is None else acceleration
        new_v = v if velocity is None else velocity
        if knots[-1] > 0.0 and (abs(new_a - a) > 1e-6 or abs(new_v - v) > 1e-9):
            jumps.append(knots[-1])
        v, a = new_v, new_a
        rows.append((jerk / 6, a / 2, v, x))
        x += length * (v + length * (a / 2 + length * jerk / 6))
        v += length * (a + length * jerk / 2)
        a += length * jerk
        knots.append(knots[-1] + length)
    return Known(PPoly(np.array(rows).T, np.array(knots)), np.array(jumps))


def trapezoids(speed, strokes=(STROKE,), hold=1.0, lead=0.0503, creep=0.0):
    """Strokes from rest to rest at a speed (of each); holds may creep (mm each)."""
    rows = [(lead, 0.0, 0.0, 0.0)]
    for stroke, most in zip(strokes, np.broadcast_to(speed, len(strokes)), strict=True):
        sign, distance = np.sign(stroke), abs(stroke)
        top = min(most, np.sqrt(LIMIT * distance))
        rise = top / LIMIT
        cruise = distance / top - rise
        rows.append((rise, 0.0, sign * LIMIT, 0.0))
        if cruise > 1e-9:
            rows.append((cruise, 0.0, 0.0, sign * top))
        rows.append((rise, 0.0, -sign * LIMIT, sign * top))
        if hold:
            rows.append((hold, 0.0, 0.0, creep / hold))
    return constant_jerk(rows, 2)


def triangle(period, cycles, turnaround=0.0):
    """Cycles at constant speed between 0 and STROKE; reversals last ``turnaround`` s each."""
    half = 0.5 * period
    v = STROKE / (half - 0.5 * turnaround)
    rows = []
    for k in range(2 * cycles):
        sign = 1 if k % 2 == 0 else -1
        first, last = k == 0, k == 2 * cycles - 1
        run = half - turnaround + (0.5 * turnaround if first else 0.0)
        run += 0.5 * turnaround if last else 0.0
        rows.append((run, 0.0, 0.0, sign * v))
        if turnaround and not last:
            rows.append((turnaround, 0.0, -2 * sign * v / turnaround, sign * v))
    return constant_jerk(rows, 2)


def s_curves(speed, jerk, strokes=(STROKE,), hold=1.0, lead=0.0503):
    """Jerk-limited moves: acceleration in triangles up to LIMIT."""
    rows = [(lead, 0.0, 0.0, 0.0)]
    for stroke in strokes:
        sign, distance = np.sign(stroke), abs(stroke)
        ramp = min(LIMIT / jerk, np.sqrt(speed / jerk))
        top_a = jerk * ramp
        flat = speed / top_a - ramp
        cruise = (distance - speed * (2 * ramp + flat)) / speed
        assert flat >= -1e-12
        assert cruise >= -1e-12
        for s in (1, -1):
            rows.append((ramp, s * sign * jerk, 0.0, None))
            if flat > 1e-9:
                rows.append((flat, 0.0, s * sign * top_a, None))
            rows.append((ramp, -s * sign * jerk, s * sign * top_a, None))
            if s > 0 and cruise > 1e-9:
                rows.append((cruise, 0.0, 0.0, sign * speed))
        rows.append((hold, 0.0, 0.0, 0.0))
    return constant_jerk(rows, 3)


def sine(frequency, cycles, phase=-0.5 * np.pi, lead=0.0):
    """STROKE/2 (1 + sin) from the turning point at 0, or from any phase."""
    wave = Wave(((STROKE / 2, frequency, phase),), STROKE / 2, cycles / frequency, np.zeros(0))
    return wave if lead == 0.0 else _after(wave, lead)


@dataclass(frozen=True)
class _Late(WithJumps):
    wave: Wave
    lead: float
    duration: float
    jumps: np.ndarray

    def at(self, t):
        moving = t >= self.lead
        return tuple(
            np.where(moving, y, rest)
            for y, rest in zip(self.wave.at(t - self.lead), (0.0, 0.0, 0.0), strict=True)
        )


def _after(wave, lead):
    return _Late(wave, lead, wave.duration + lead, np.array([lead]))


def hand(seed, duration=20.0):
    rng = np.random.default_rng(seed)
    moves = tuple(
        (rng.uniform(0.2, 0.8), rng.uniform(2.0, duration - 2.0), np.exp(rng.uniform(-1.2, 0.4)))
        for _ in range(10)
    )
    return Bumps(moves, duration, np.zeros(0))


def sampled(motion, interval, jitter=0.0, seed=0):
    """Times a logger would take, jittered by a share of the interval."""
    rng = np.random.default_rng(seed)
    n = int(motion.duration / interval + 1e-9) + 1
    t = interval * np.arange(n)
    t[1:-1] += jitter * interval * rng.uniform(-1.0, 1.0, n - 2)
    return t


def rounded(x, step, offset=0.0):
    """Rounded to an encoder's steps."""
    return np.round((x + offset) / step) * step


def read(x, step, seed=0):
    """Rounded to an encoder step with its zero anywhere; as it is for a step of 0."""
    if step == 0.0:
        return x, 0.0
    offset = np.random.default_rng(seed).uniform(0.0, step)
    return rounded(x, step, offset), offset


def stairs_that_creep():
    """A staircase up and down whose set point creeps by 5 um in each hold."""
    return trapezoids(10.0, (0.4, 0.4, 0.4, -0.4, -0.4), hold=2.0, creep=0.005)


def uneven(motion, readings, seed=5):
    """Times of a logger that thins: gaps between samples vary by a factor of 8."""
    gaps = np.exp(np.random.default_rng(seed).uniform(0.0, np.log(8.0), readings - 1))
    return np.append(0.0, np.cumsum(gaps)) * motion.duration / gaps.sum()


def steered(speed, ramp_up, *, jerk=0.0, stroke=5.0, rest=2.0, back=0.0, ends=False):
    """A platen that moves in and back at a speed (mm/s) reached within ramp_up (s), and rests.

    Returns time (s), displacement, velocity and acceleration; ends: with the movement back.
    """
    step = 1e-3

    def move(length):
        ends = [0.0, ramp_up, length / speed, length / speed + ramp_up]
        return np.interp(np.arange(0.0, ends[-1], step), ends, [0.0, speed, speed, 0.0])

    still = np.zeros(round(rest / step))
    velocity = np.concatenate(
        [still, move(stroke), still, -move(back), still[: 0 if ends else None]]
    )
    if jerk:
        width = round(jerk / step)
        velocity = np.convolve(velocity, np.full(width, 1.0 / width), mode="same")
    time, displacement = step * np.arange(velocity.size), step * np.cumsum(velocity)
    return time, displacement, velocity, np.gradient(velocity, step)
