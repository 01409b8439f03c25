"""Figures as tests look at them."""

import numpy as np

from qlvbayes.fitting.prediction import Prediction
from qlvbayes.io.data import Test as Record
from qlvbayes.motion.experiment import Trial
from qlvbayes.motion.phases import Phase
from qlvbayes.motion.trajectory import smooth
from qlvbayes.plots.files import figure_of

NOISE = 0.01
DWELLS = ("hold", "recovery")


def protocol(moves, speed, rest, at=0.0):
    """Phases of some movements, each with a rest after it."""
    phases = []
    for move in moves:
        stop = at + abs(move) / speed
        phases.append(Phase("ramp" if move > 0 else "unload", at, stop))
        phases.append(Phase("hold" if move > 0 else "recovery", stop, stop + rest))
        at = stop + rest
    return tuple(phases)


def samples(phase):
    length = phase.stop - phase.start
    if phase.kind in DWELLS:
        return phase.start + length * np.geomspace(1e-3, 0.999, 40)
    return phase.start + length * np.arange(30) / 30.0


def prediction(name, phases, rate, role="validate", time=None, force=lambda t: np.cos(9.0 * t)):
    """A prediction that is off by no more than noise."""
    rng = np.random.default_rng(5)
    time = np.concatenate([samples(p) for p in phases]) if time is None else time
    mean = force(time)
    observed = mean + NOISE * rng.standard_normal(time.size)
    test = Record(name, "B", time, time, observed, None, None, None, 0.0)
    trial = Trial(test, smooth(time, time), phases, rate, role)
    draws = mean + 0.1 * NOISE * rng.standard_normal((200, 1))
    floor = NOISE * rng.standard_normal((200, time.size))
    low, high = mean - 1.7 * NOISE, mean + 1.7 * NOISE
    return Prediction(
        trial, time, trial.phase_of(time), observed, mean, low, high, draws, floor
    )  # fmt: skip


def page(plot, *args, **options):
    """The figure that a function drew."""
    return figure_of(plot(*args, **options))
