"""Forces of solids that remember, and pads made ready from a few tests."""

import pickle
from functools import cache

import numpy as np

from qlvbayes.io.data import Pad
from qlvbayes.io.units import PAD
from qlvbayes.motion.experiment import prepare


def solid(time, elastic, lasting, fading, tau):
    """A standard linear solid over an elastic course: lasting + fading e^{-t / tau (s)}."""
    keep, memory = np.exp(-np.diff(time) / tau), [0.0]
    for rise, left in zip(np.diff(elastic), keep, strict=True):
        memory.append(left * memory[-1] + np.sqrt(left) * rise)
    return lasting * (elastic - elastic[0]) + fading * np.array(memory)


def made_ready(*tests, units=PAD, **chosen):
    """The experiment of a pad with these tests; the same ones are made ready once."""
    return _made_ready(pickle.dumps((tests, units, chosen)))


@cache
def _made_ready(pickled):
    tests, units, chosen = pickle.loads(pickled)
    return prepare(Pad("p", tests, units), **chosen)


def kinds(phases):
    """What each phase is called."""
    return [phase.kind for phase in phases]
