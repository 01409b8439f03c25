"""A simulated test as the model sees it: grids of times dense where the force bends."""

import jax.numpy as jnp
import numpy as np

from qlvbayes.laws.motion import Motion
from qlvbayes.simulate import full_retraction_protocol, paper_protocol

CLOSE = 1e-4  # of the peak force
START = 500.0  # s, the clock as the test begins
PROTOCOLS = {"paper": paper_protocol, "retraction": full_retraction_protocol}
POINTS = 2560  # one size of grid, one compilation of each part


def grid_of(platen):
    """Times dense where the platen speeds up and after each of its kinks."""
    even, early = np.linspace(0.0, 1.0, 151), np.linspace(0.0, 1.0, 161) ** 4
    parts = [
        p.start + p.duration * (even if p.acceleration or p.velocity else early)
        for p in platen.pieces
    ]
    time = np.unique(np.concatenate([*parts, platen.kinks]))
    assert time.size <= POINTS
    time = np.clip(time, 0.0, platen.duration)
    return time[np.append(True, np.diff(time) > 1e-9)]


def motion_of(platen, time):
    """The motion at these times, filled up to the one size."""
    full = np.pad(time, (0, POINTS - time.size), mode="edge")
    along = (platen.displacement(full), platen.velocity(full), platen.acceleration(full))
    return Motion(*map(jnp.asarray, (full, *along)), start=platen.start_s, number=platen.number)
