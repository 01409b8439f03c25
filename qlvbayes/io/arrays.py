"""Types of NumPy arrays that annotations name, and values as JSON has them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""Real values."""
Mask = NDArray[np.bool_]
"""True for what is selected."""


def finite_or_none(value: float) -> float | None:
    """Return a value, or None where it is not finite, as JSON has no such number."""
    return float(value) if np.isfinite(value) else None
