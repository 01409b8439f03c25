r"""How often an effect with such evidence was there, in blind studies: a calibrated probability.

The posterior over hypotheses is right only where the truth is among them. The certainty corrects it
by what happened in registered blind studies away from the paper's rig, where things that no list
holds were hidden too. It is a logistic regression,

.. math:: \ln \frac{c}{1 - c} = w_0 + \sum_{k=1}^4 w_k x_k,

on four features of a finished diagnosis: how strong the evidence for the effect is, how much better
tests left out are predicted once it is in the model, how large the error of the answer still is,
and whether the answer leaves structure. `validation/certainty.py` learns the weights and checks
them on studies that they were not learnt from; ``certainty.json`` says from which.
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
from numpy.typing import NDArray

from qlvbayes.diagnosis.result import Stage

Array = NDArray[np.float64]

FEATURES = ("evidence", "heldout_gain", "error_left", "structure_left")
"""In the order of the weights."""
STRUCTURE = 0.01
"""p-value of the adequacy test below which the answer counts as leaving structure."""
LEAST = 0.1
"""Posterior probability that an effect must have: others were not learnt from."""


def features(effect: str, log_bayes_factor: float, steps: Sequence[Stage], noise: float) -> Array:
    """(4,) features of an effect, by its log Bayes factor, the steps and the noise floor (N).

    evidence: asinh of the log Bayes factor, which is a logarithm where that is large; heldout_gain:
    log of the error on tests left out before the step at which the effect was added over that
    after it, 0 where it is not in the answer; error_left: log of the answer's error over the noise
    floor; structure_left: 1 where the answer leaves structure, else 0.
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
    for before, after in pairwise(steps):
        if effect in after.effects and effect not in before.effects:
            first, then = before.heldout_rmse, after.heldout_rmse
            return math.log(first / then) if first and then else 0.0
    return 0.0


@dataclass(frozen=True)
class Calibration:
    """Weights of the logistic regression and where they come from.

    weights (5,): the constant first; low, high (4,): range of each feature in the studies; names,
    studies: how many were learnt from; runs: the registered runs; bins: of certainty (low, high),
    in studies left out, how many names there were and how many of them were right.
    """

    weights: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    names: int
    studies: int
    runs: tuple[str, ...]
    bins: tuple[tuple[float, float, int, int], ...]

    def __call__(self, x: Array) -> float | None:
        """Certainty at features (4,); None outside of the range that was learnt from."""
        if not bool(np.all((x >= self.low) & (x <= self.high))):
            return None
        return float(1.0 / (1.0 + math.exp(-self.weights[0] - float(np.dot(self.weights[1:], x)))))

    def bin_of(self, certainty: float) -> tuple[float, float, int, int]:
        """The bin that a certainty lies in."""
        return next(one for one in reversed(self.bins) if certainty >= one[0])


@cache
def calibration() -> Calibration:
    """As it comes with the package."""
    return msgspec.json.decode(Path(__file__).with_suffix(".json").read_bytes(), type=Calibration)


def certainty(
    effect: str,
    probability: float,
    log_bayes_factor: float | None,
    steps: Sequence[Stage],
    noise: float,
) -> float | None:
    """Calibrated probability that an effect is there.

    None where its posterior probability is below `LEAST`, where nothing without it was looked at,
    or where a feature lies outside of what was learnt from.
    """
    if probability < LEAST or log_bayes_factor is None or not noise > 0.0:
        return None
    return calibration()(features(effect, log_bayes_factor, steps, noise))
