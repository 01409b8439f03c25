"""A program: displacement or force prescribed over time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

MOST = 50_000  # points; 400 draws of them are 160 MB


@dataclass(frozen=True, eq=False)
class Program:
    """Points (N,) between which the prescribed quantity goes straight, from a specimen at rest."""

    title: str  # the text that was given, or the name of its file
    quantity: Literal["displacement", "force"]  # the prescribed quantity
    time: np.ndarray  # times (N,) in s, never decreasing
    value: np.ndarray  # displacement or force (N,) in the units of the fit
    rate: np.ndarray  # its slope (N,) just after each point, per s

    @property
    def jumps(self) -> tuple[float, ...]:
        """Times (s) of its jumps: two points of one time with different values."""
        jumping = (np.diff(self.time) == 0.0) & (np.diff(self.value) != 0.0)
        return tuple(self.time[:-1][jumping].tolist())

    @property
    def longest_rest(self) -> float:
        """Longest time (s) for which the value stays as it is."""
        same = np.diff(self.value) == 0.0
        longest = began = 0.0
        for k, still in enumerate(same):
            began = began if still and k and same[k - 1] else float(self.time[k])
            longest = max(longest, float(self.time[k + 1]) - began) if still else longest
        return longest
