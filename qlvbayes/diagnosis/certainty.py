r"""The certainty: a probability that was calibrated on blind studies.

It is how often an effect with such evidence was there in registered blind studies away from the
paper's rig, in which unmodelled things were hidden too, by a logistic regression,

.. math:: \ln \frac{c}{1 - c} = w_0 + \sum_{k=1}^6 w_k x_k,

on the evidence for the effect and its support (`checks.support`). Features beyond the range that
was learnt from count as its end. `validation/certainty.py` learns the weights; ``certainty.json``
names the runs. It is multiplied by the share of the effect's force that one strength makes
(`checks.strengths`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import msgspec
import numpy as np

from qlvbayes.diagnosis.result import Support
from qlvbayes.io.arrays import Array

FEATURES = (
    "evidence",
    "heldout_gain",
    "heldout_sds",
    "error_left",
    "structure_left",
    "effects",
)
"""Names of the features, in the order of the weights."""
STRUCTURE = 0.01
"""P-value of the adequacy test below which a hypothesis counts as leaving structure."""
_SURE = 5.0  # sds beyond which a gain on tests left out counts as no surer
LEAST = 0.1
"""Least posterior probability of an effect: less probable ones were not learnt from."""


def features(log_bayes_factor: float, support: Support) -> Array:
    """Return the features (6,) of an effect."""
    return np.array(
        [
            math.asinh(log_bayes_factor),
            support.heldout_gain,
            min(max(support.heldout_sds, -_SURE), _SURE),
            support.error_left,
            float(support.p_left < STRUCTURE),
            float(support.effects),
        ]
    )


@dataclass(frozen=True)
class Calibration:
    """The weights of the logistic regression, and the studies they come from."""

    weights: tuple[float, ...]  # 8 of them, the constant first
    # low, high: range (6,) of each feature in the studies
    low: tuple[float, ...]
    high: tuple[float, ...]
    # names, studies: numbers of effects and of studies that were learnt from
    names: int
    studies: int
    runs: tuple[str, ...]  # names of the registered runs
    # low and high end of each bin of certainty, with the number of effects in it and how many of
    # them were there, in studies left out
    bins: tuple[tuple[float, float, int, int], ...]

    def __call__(self, x: Array) -> float:
        """Return the certainty at features (6,)."""
        inside = np.clip(x, self.low, self.high)
        return float(1.0 / (1.0 + math.exp(-self.weights[0] - inside @ self.weights[1:])))

    def bin_of(self, certainty: float) -> tuple[float, float, int, int]:
        """Return the bin that a certainty lies in."""
        return next(one for one in reversed(self.bins) if certainty >= one[0])


@cache
def calibration() -> Calibration:
    """Return the calibration that comes with the package."""
    return msgspec.json.decode(Path(__file__).with_suffix(".json").read_bytes(), type=Calibration)


def certainty(
    probability: float, log_bayes_factor: float | None, support: Support | None
) -> float | None:
    """Return the calibrated probability that an effect is there."""
    if probability < LEAST or log_bayes_factor is None or support is None:
        return None
    sure = calibration()(features(log_bayes_factor, support))
    return sure * (1.0 if support.strengths is None else support.strengths.agreement)
