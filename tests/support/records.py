"""What the noise floor sees of a test."""

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter


@dataclass(frozen=True)
class Record:
    """Times (s) and forces, perhaps with their sds and the displacement; else that rests."""

    time: np.ndarray
    force: np.ndarray
    force_sd: np.ndarray | None = None
    displacement: np.ndarray | None = None

    def __post_init__(self):
        if self.displacement is None:
            object.__setattr__(self, "displacement", np.zeros(self.time.size))


def correlated(size, sd, tau, rng, step=1e-3):
    """Noise of an Ornstein-Uhlenbeck process of an sd and a time (s), read every step (s)."""
    keep = np.exp(-step / tau)
    kicks = sd * np.sqrt(1.0 - keep**2) * rng.normal(size=size)
    kicks[0] = sd * rng.normal()
    return lfilter([1.0], [1.0, -keep], kicks)
