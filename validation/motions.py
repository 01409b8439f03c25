"""Compare fitted motions with the true ones, over encoders, scatter, loggers and motions.

python validation/motions.py [share]: of all combinations that share (default 1), drawn with a fixed
seed. Printed are, for each kind of motion and in all: how many records; how many fitted motions lie
farther than two resolutions (the larger of encoder step and scatter, at least 1e-4 of the stroke)
from the true motion, farther than ten, and farther than two without a notice of it; how many have
phases other than the motion's; the median and the largest number of knots; and the seconds they
took.
"""

from __future__ import annotations

import sys
import time as clock
from itertools import groupby, product

import numpy as np

from qlvbayes.io.checks import InputError
from qlvbayes.motion.phases import find_phases
from qlvbayes.motion.trajectory import smooth

STEPS = (0.0, 1e-4, 1e-3, 1e-2)  # mm
SCATTERS = (0.0, 0.05, 0.1, 0.25, 0.5, 1.0, 3.0, 10.0)  # steps; of 1 um where there is none
RATES = (10.0, 50.0, 200.0, 1000.0, 5000.0)  # Hz
LOGGERS = ("even", "jittered", "thinned", "averaged", "few digits")
MOST = 40_000  # readings of a record


def lines(*corners):
    """Straight lines through (time, depth) corners."""
    t, x = np.array(corners, dtype=float).T
    return lambda at: np.interp(at, t, x)


def trapezoid(at):
    """2 mm at 2 mm/s with an acceleration of 20 mm/s2, from 0.5 s on."""
    s = np.clip(at - 0.5, 0.0, 1.1)
    early, late = np.minimum(s, 0.1), np.maximum(s - 1.0, 0.0)
    return 10.0 * early**2 + 2.0 * np.clip(s - 0.1, 0.0, 0.9) + 2.0 * late - 10.0 * late**2


def overshooting(at):
    """2 mm within 0.2 s, 3 % too far, and back within 0.1 s."""
    s = np.maximum(at - 0.7, 0.0)
    ring = 0.06 * np.exp(-s / 0.03) * np.cos(s / 0.02)
    ramp = 2.06 * np.clip((at - 0.5) / 0.2, 0.0, 1.0)
    return np.where(at < 0.7, ramp, 2.0 + ring)


MOTIONS = {  # depth (mm) at times, seconds, phases by their first letters
    "sharp ramp": (lines((0, 0), (0.5, 0), (1.5, 2), (9, 2)), 9.0, "hrh"),
    "trapezoid": (trapezoid, 9.0, "hrh"),
    "overshoot": (overshooting, 9.0, "hrh"),
    "staircase": (
        lines((0, 0), (0.5, 0), (1, 0.5), (3, 0.5), (3.5, 1), (6, 1), (6.5, 1.5), (9, 1.5)),
        9.0,
        "hrhrhrh",
    ),
    "sine": (lambda at: 1.0 - np.cos(2.0 * np.pi * at / 3.0), 9.0, "rururu"),
    "triangles": (
        lines((0, 0), (1.5, 2), (3, 0), (4.5, 2), (6, 0), (7.5, 2), (9, 0)),
        9.0,
        "rururu",
    ),
    "retraction": (lines((0, 0), (0.5, 0), (1.5, 2), (5, 2), (6, 0), (9, 0)), 9.0, "hrhur"),
    "creep under load": (
        lambda at: (
            1.0
            - np.exp(-np.maximum(at - 0.5, 0.0) / 0.1)
            + 0.3 * (1.0 - np.exp(-np.maximum(at - 0.5, 0.0) / 3.0))
        ),
        9.0,
        "",
    ),
    "very slow": (lines((0, 0), (1, 0), (21, 2), (30, 2)), 30.0, "hrh"),
}


def record(motion, seconds, step, scatter, rate, logger, rng):
    """Times, readings, and the true motion at these times (with the encoder's zero)."""
    size = min(int(seconds * rate), MOST)
    t = np.arange(size) / rate
    if logger == "jittered":
        t = np.sort(t + rng.uniform(-0.2, 0.2, size) / rate)
    true = motion(t) + step * rng.uniform()
    noise = scatter * (step or 1e-3)
    x = true + noise * rng.normal(size=size)
    x = np.round(x / step) * step if step else x
    if logger == "averaged":
        t, x, true = (y[: size // 4 * 4].reshape(-1, 4).mean(axis=1) for y in (t, x, true))
    elif logger == "few digits":
        t, x = np.round(t, 3), np.asarray(x, dtype=np.float32).astype(float)
        kept = np.append(True, np.diff(t) > 0.0)
        t, x, true = t[kept], x[kept], true[kept]
    elif logger == "thinned":
        stored = [0]
        least = max(2.0 * step, 3.0 * noise, 1e-3)
        for k in range(1, size):
            if abs(x[k] - x[stored[-1]]) >= least or t[k] - t[stored[-1]] > 0.5:
                stored.append(k)
        t, x, true = t[stored], x[stored], true[stored]
    return t, x, true, max(step, noise, 1e-4 * float(np.ptp(true)))


def outcome(motion, seconds, kinds, settings, rng):
    """(distance over resolution, if untold, if phases differ, knots, seconds) of one record."""
    t, x, true, resolution = record(motion, seconds, *settings, rng)
    begun = clock.perf_counter()
    fit = smooth(t, x)
    took = clock.perf_counter() - begun
    off = float(np.abs(fit.displacement(t) - true).max()) / resolution
    try:
        found = "".join(phase.kind[0] for phase in find_phases(fit))
    except InputError:
        found = "-"
    untold = off > 2.0 and fit.departure is None
    return off, untold, bool(kinds) and found != kinds, fit.knots.size, took


def main(share):
    """Print the counts."""
    rng = np.random.default_rng(7)
    every = [
        (name, settings)
        for name, *settings in product(MOTIONS, STEPS, SCATTERS, RATES, LOGGERS)
        if rng.uniform() < share
    ]
    rows = []
    print(f"{'motion':18} records  >2  >10  untold  phases  knots (most)  seconds")
    for name, group in groupby(every, lambda one: one[0]):
        found = [outcome(*MOTIONS[name], settings, rng) for _, settings in group]
        rows += found
        print(_line(name, found), flush=True)
    print(_line("all", rows))


def _line(name, found):
    off, untold, wrong, knots, took = (np.array(column) for column in zip(*found, strict=True))
    return (
        f"{name:18} {off.size:7} {np.sum(off > 2):3} {np.sum(off > 10):4} {np.sum(untold):7} "
        f"{np.sum(wrong):7} "
        f"{np.median(knots):6.0f} ({knots.max()}) {took.sum():8.1f}"
    )


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 1.0)
