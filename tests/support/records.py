"""What the noise floor sees of a test."""

from dataclasses import dataclass

import numpy as np


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
