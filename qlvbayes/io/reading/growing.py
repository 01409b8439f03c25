"""A column that grows as blocks of a file come in."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


class GrowingColumn:
    """Float64 values appended in blocks; memory stays that of the values.

    A list of blocks joined at the end would need the memory twice, for the allocator keeps the
    freed blocks. A large array is enlarged in place; by an eighth only, as numpy fills the spare
    room with zeros.
    """

    def __init__(self) -> None:
        self._values = np.empty(1024)
        self._size = 0

    def append(self, block: NDArray[np.float64]) -> None:
        """Append a copy of the block."""
        size = self._size + len(block)
        if size > len(self._values):
            self._values.resize(size + size // 8, refcheck=False)
        self._values[self._size : size] = block
        self._size = size

    def finish(self) -> NDArray[np.float64]:
        """Give the values away; the column is empty then."""
        values, self._values = self._values, np.empty(1024)
        values.resize(self._size, refcheck=False)
        self._size = 0
        return values
