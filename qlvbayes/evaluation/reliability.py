r"""Whether the probabilities keep what they promise.

Of the studies in which nothing or one listed effect is missing: the probability of the first-ranked
hypothesis against how often it is the true one. The expected calibration error is

.. math:: \sum_b \frac{n_b}{n} |\bar p_b - s_b|

over ten bins of equal width, with mean probability p_b and share right s_b. Of few studies chance
alone makes some: what probabilities that are exactly right would show on as many is given with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np

from qlvbayes.evaluation.rate import Case, Rate

BINS = 10  # of stated probability: tenths
_REPEATS = 1000  # of the bootstrap


@dataclass(frozen=True)
class Bin:
    """Studies whose probability lies in one tenth."""

    low: float
    high: float
    probability: float
    right: Rate


@dataclass(frozen=True)
class Reliability:
    """Bins that are not empty, and the expected calibration error (None of no studies).

    by_chance: the mean error if the probabilities were exactly right.
    """

    n: int
    bins: tuple[Bin, ...]
    error: float | None
    by_chance: float | None

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
        probability, right = pairs.T
        place = tenths(probability)
        bins = []
        for k in np.unique(place).tolist():
            some = place == k
            rate = Rate(int(right[some].sum()), int(some.sum()))
            bins.append(Bin(k / BINS, (k + 1) / BINS, float(probability[some].mean()), rate))
        if not bins:
            return cls(0, (), None, None)
        drawn = np.random.default_rng(0).random((_REPEATS, right.size)) < probability
        by_chance = np.mean([_error(probability, one, place) for one in drawn])
        return cls(len(pairs), tuple(bins), _error(probability, right, place), float(by_chance))

    def as_dict(self) -> dict:
        """For JSON."""
        bins = [asdict(b) | {"right": b.right.as_dict()} for b in self.bins]
        return {
            "n": self.n,
            "expected_calibration_error": self.error,
            "by_chance": self.by_chance,
            "bins": bins,
        }


def tenths(probability: np.ndarray) -> np.ndarray:
    """Place of each probability among the bins."""
    return np.minimum((probability * BINS).astype(int), BINS - 1)


def _error(probability: np.ndarray, right: np.ndarray, place: np.ndarray) -> float:
    """Expected calibration error of studies in bins ``place``."""
    gaps = np.bincount(place, probability - right)
    return float(np.abs(gaps).sum() / right.size)


def first_ranked(case: Case) -> tuple[float, bool]:
    """Probability of the first-ranked hypothesis, and whether it is the true one."""
    best = max(case["probabilities"], key=lambda name: case["probabilities"][name])
    return case["probabilities"][best], best == (case["names"][0] if case["names"] else "none")
