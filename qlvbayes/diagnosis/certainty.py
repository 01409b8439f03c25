r"""The certainty: a probability that was calibrated on blind studies.

The posterior over hypotheses is right only where the truth is among them. The certainty corrects it
by what happened in registered blind studies away from the paper's rig, in which unmodelled things
were hidden too. It is how often an effect with such evidence was there, by a logistic regression,

.. math:: \ln \frac{c}{1 - c} = w_0 + \sum_{k=1}^4 w_k x_k,

on four features of a finished diagnosis: how strong the evidence for the effect is, how much better
tests left out are predicted once it is in the model, how large the error of the answer still is,
and whether the answer leaves structure. `validation/certainty.py` learns the weights and checks
them on studies that they were not learnt from; ``certainty.json`` names the runs.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from pathlib import Path

import msgspec
import numpy as np

from qlvbayes.diagnosis.result import Stage
from qlvbayes.io.arrays import Array

FEATURES = ("evidence", "heldout_gain", "error_left", "structure_left")
"""Names of the features, in the order of the weights."""
STRUCTURE = 0.01
"""P-value of the adequacy test below which the answer counts as leaving structure."""
LEAST = 0.1
"""Least posterior probability of an effect: less probable ones were not learnt from."""


def features(effect: str, log_bayes_factor: float, steps: Sequence[Stage], noise: float) -> Array:
    """Return the features (4,) of an effect.

    The evidence is asinh of the log Bayes factor, which is a logarithm where that is large. The
    gain is the log of the error on tests left out before the step that adds the effect over that
    after it, and 0 where the answer does not hold the effect. The error left is the log of the
    answer's error over the noise floor. The structure left is 1 where the answer leaves
    structure, and 0 elsewhere.

    Parameters
    ----------
    effect
        Name of the effect.
    log_bayes_factor
        Its log Bayes factor.
    steps
        Hypotheses from the baseline to the answer.
    noise
        Sd of the noise floor (N).
    """
    last = steps[-1]
    return np.array(
        [
            math.asinh(log_bayes_factor),
            _gain(effect, steps),
            math.log(max(last.rmse, 1e-300) / noise),
            float(last.p_value < STRUCTURE),
        ]
    )


def _gain(effect: str, steps: Sequence[Stage]) -> float:
    """Return the log of the factor by which an effect lowers the error on tests left out."""
    for before, after in pairwise(steps):
        if effect in after.effects and effect not in before.effects:
            first, then = before.heldout_rmse, after.heldout_rmse
            return math.log(first / then) if first and then else 0.0
    return 0.0


@dataclass(frozen=True)
class Calibration:
    """The weights of the logistic regression, and the studies they come from.

    Parameters
    ----------
    weights
        The weights (5,), the constant first.
    low, high
        Range (4,) of each feature in the studies.
    names, studies
        Numbers of effects and of studies that were learnt from.
    runs
        Names of the registered runs.
    bins
        Low and high end of each bin of certainty, with the number of effects in it and how many of
        them were there, in studies left out.
    """

    weights: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    names: int
    studies: int
    runs: tuple[str, ...]
    bins: tuple[tuple[float, float, int, int], ...]

    def __call__(self, x: Array) -> float | None:
        """Return the certainty at features (4,); None outside the range that was learnt from."""
        if not bool(np.all((x >= self.low) & (x <= self.high))):
            return None
        return float(1.0 / (1.0 + math.exp(-self.weights[0] - float(np.dot(self.weights[1:], x)))))

    def bin_of(self, certainty: float) -> tuple[float, float, int, int]:
        """Return the bin that a certainty lies in."""
        return next(one for one in reversed(self.bins) if certainty >= one[0])


@cache
def calibration() -> Calibration:
    """Return the calibration that comes with the package."""
    return msgspec.json.decode(Path(__file__).with_suffix(".json").read_bytes(), type=Calibration)


def certainty(
    effect: str,
    probability: float,
    log_bayes_factor: float | None,
    steps: Sequence[Stage],
    noise: float,
) -> float | None:
    """Return the calibrated probability that an effect is there.

    Parameters
    ----------
    effect, probability, log_bayes_factor
        The effect with its inclusion probability and its log Bayes factor.
    steps
        Hypotheses from the baseline to the answer.
    noise
        Sd of the noise floor (N).

    Returns
    -------
    float or None
        None where the inclusion probability is below `LEAST`, where no hypothesis without the
        effect was evaluated, or where a feature lies outside the range that was learnt from.
    """
    if probability < LEAST or log_bayes_factor is None or not noise > 0.0:
        return None
    return calibration()(features(effect, log_bayes_factor, steps, noise))
