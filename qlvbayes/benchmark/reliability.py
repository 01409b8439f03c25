r"""Whether the probabilities keep what they promise.

Of the studies in which nothing or one listed effect is missing: the probability of the first-ranked
hypothesis against how often it is the true one. The expected calibration error is

.. math:: \sum_b \frac{n_b}{n} |\bar p_b - s_b|

over ten bins of equal width, with mean probability p_b and share right s_b.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np

from qlvbayes.benchmark.rate import Case, Rate

BINS = 10


@dataclass(frozen=True)
class Bin:
    """Studies whose probability lies in one tenth."""

    low: float
    high: float
    probability: float
    right: Rate


@dataclass(frozen=True)
class Reliability:
    """Bins that are not empty, and the expected calibration error (None of no studies)."""

    n: int
    bins: tuple[Bin, ...]
    error: float | None

    @classmethod
    def of(cls, cases: Sequence[Case]) -> Reliability:
        """Bin the first-ranked hypotheses."""
        pairs = np.array(
            [
                first_ranked(case)
                for case in cases
                if case["kind"] in ("none", "single") and "probabilities" in case
            ]
        ).reshape(-1, 2)
        place = np.minimum((pairs[:, 0] * BINS).astype(int), BINS - 1)
        bins = []
        for k in np.unique(place).tolist():
            probability, right = pairs[place == k].T
            rate = Rate(int(right.sum()), right.size)
            bins.append(Bin(k / BINS, (k + 1) / BINS, float(probability.mean()), rate))
        gaps = [b.right.n * abs(b.probability - b.right.hits / b.right.n) for b in bins]
        return cls(len(pairs), tuple(bins), sum(gaps) / len(pairs) if bins else None)

    def as_dict(self) -> dict:
        """For JSON."""
        bins = [asdict(b) | {"right": b.right.as_dict()} for b in self.bins]
        return {"n": self.n, "expected_calibration_error": self.error, "bins": bins}


def first_ranked(case: Case) -> tuple[float, bool]:
    """Probability of the first-ranked hypothesis, and whether it is the true one."""
    best = max(case["probabilities"], key=lambda name: case["probabilities"][name])
    return case["probabilities"][best], best == (case["names"][0] if case["names"] else "none")
