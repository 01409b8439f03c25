"""Laws and motions that exports are compared on."""

import jax.numpy as jnp
import numpy as np

from qlvbayes.laws.layered import Contact, Law
from qlvbayes.laws.motion import Motion

LAWS = ["exponential", "linear", "polynomial:2", "polynomial:3", "toe", "hertz"]


def python_force(pad, time, depth):
    """The Python model's force of the middle draw, in contact."""
    time, depth = jnp.asarray(time), jnp.asarray(depth)
    zero = jnp.zeros_like(time)
    layers = () if pad.choices.bonded else (Contact(),)
    law = Law(pad.elastic, pad.relaxation, layers)
    return np.asarray(law.force(Motion(time, depth, zero, zero)))


def retracting():
    """Pressed, held, pulled away fast, left, pressed again: contact is lost and found."""
    time = np.concatenate(
        [np.linspace(0, 0.1, 40), np.linspace(0.2, 3, 30), np.linspace(3.01, 5, 80)]
    )
    depth = np.interp(
        time, [0.0, 0.1, 3.0, 3.05, 3.5, 4.0, 5.0], [0.0, 1.6, 1.6, -0.2, -0.2, 1.0, 0.3]
    )
    return time, depth
