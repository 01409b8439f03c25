"""Laws and motions that exports are compared on."""

import numpy as np

LAWS = ["exponential", "linear", "polynomial:2", "polynomial:3", "toe", "hertz"]


def retracting():
    """Pressed, held, pulled away fast, left, pressed again: contact is lost and found."""
    time = np.concatenate(
        [np.linspace(0, 0.1, 40), np.linspace(0.2, 3, 30), np.linspace(3.01, 5, 80)]
    )
    depth = np.interp(
        time, [0.0, 0.1, 3.0, 3.05, 3.5, 4.0, 5.0], [0.0, 1.6, 1.6, -0.2, -0.2, 1.0, 0.3]
    )
    return time, depth
