"""The types of NumPy arrays that annotations name."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""Real values."""
Mask = NDArray[np.bool_]
"""True for what is selected."""
