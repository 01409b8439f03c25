"""A share of studies with its standard error."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from math import sqrt
from typing import Any

Case = dict[str, Any]


@dataclass(frozen=True)
class Rate:
    """``hits`` of ``n`` studies."""

    hits: int
    n: int

    @classmethod
    def of(cls, cases: Iterable[Case], hit: Callable[[Case], bool]) -> Rate:
        """Count the cases that hit."""
        found = [hit(case) for case in cases]
        return cls(sum(found), len(found))

    @property
    def share(self) -> float | None:
        """Hits over n; None of no studies."""
        return self.hits / self.n if self.n else None

    @property
    def error(self) -> float | None:
        """Binomial standard error sqrt(p (1 - p)/n), p = (hits + 1)/(n + 2), never 0."""
        share = (self.hits + 1.0) / (self.n + 2.0)
        return sqrt(share * (1.0 - share) / self.n) if self.n else None

    def as_dict(self) -> dict:
        """For JSON."""
        return {"hits": self.hits, "n": self.n, "share": self.share, "standard_error": self.error}

    def __str__(self) -> str:
        if self.share is None or self.error is None:
            return "-"
        return f"{100 * self.share:.1f} ± {100 * self.error:.1f} %"
