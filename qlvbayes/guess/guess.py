r"""A first guess: how likely each effect is missing, learnt from simulated pads, from one fit.

A guess is the mean of several logistic regressions, each learnt from another draw of the pads,

.. math:: p_k = \frac{1}{1 + e^{-u_k}}, \quad u_k = w_0 + w_k + \sum_j w_j z_{kj},

over the standardised features z of effect k and of the record (`features`); all effects share the
weights but for w_k. Two more regressions, on the record's features alone, say how likely nothing is
missing that the tests could show, and how likely something is there that no list holds. Several
effects may be missing, so that the probabilities need not add up to one. They are those of pads
like the simulated ones, whose effects are half a per cent to 15 % of the peak force. A record whose
features are farther from theirs than any of them gets no guess.

`validation/learn_guess.py` learns ``weights.json``; docs/reliability.md says what it is worth.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import msgspec
import numpy as np

from qlvbayes.guess.features import COMMON, GuessFeatures, features_of
from qlvbayes.guess.responses import responses_of
from qlvbayes.io.arrays import Array
from qlvbayes.model.choices import Choices
from qlvbayes.motion.experiment import Experiment

_LIKELY = 0.1  # probability from which an effect is in the sentence,
_MOST = 3  # and how many are
_FARTHEST = 3.0  # sds of a feature, beyond which its weight is not extrapolated


@dataclass(frozen=True)
class Likely:
    """A probability, and the lowest and highest that one of the regressions gives."""

    probability: float
    low: float
    high: float

    def __str__(self) -> str:
        low, high = round(100.0 * self.low), round(100.0 * self.high)
        return f"{100.0 * self.probability:.0f} % ({low} to {high} %)"


@dataclass(frozen=True)
class Guess:
    """A first guess of what is missing in a pad's model.

    effects: of each effect that the tests can show, the likeliest first; nothing: that nothing is
    missing which the tests could show; unlisted: that something is there which no list holds.
    unlike: how far the record is from those learnt from; if it is not empty, there is no guess.
    """

    pad: str
    effects: dict[str, Likely]
    nothing: Likely | None
    unlisted: Likely | None
    unlike: str = ""

    @property
    def sentence(self) -> str:
        """The guess in a sentence or two."""
        if self.nothing is None or self.unlisted is None:
            return (
                "No first guess: this record is unlike the simulated ones that it is learnt from "
                f"({self.unlike}). `qlvbayes diagnose` does not need it."
            )
        likely = [(k, p) for k, p in self.effects.items() if p.probability >= _LIKELY][:_MOST]
        named = [f"{effect} {p}" for effect, p in likely] or ["no effect above 10 %"]
        rest = [
            f"nothing missing {100.0 * self.nothing.probability:.0f} %",
            f"something that no list holds {100.0 * self.unlisted.probability:.0f} %",
        ]
        return f"First guess from one fit: {', '.join(named + rest)}. `qlvbayes diagnose` decides."


class Member(msgspec.Struct, frozen=True):
    """The weights of one member, the constant first: of effects, of nothing, of unlisted."""

    effects: list[float]
    bias: dict[str, float]
    nothing: list[float]
    unlisted: list[float]


class Weights(msgspec.Struct, frozen=True):
    """The weights that were learnt, with their origin.

    mean, sd: of each feature of an effect, the record's last; precision: of the record's
    standardised features; farthest: the largest distance from their mean (Mahalanobis) at which
    there is a guess; origin: run, seed and number of pads.
    """

    mean: list[float]
    sd: list[float]
    precision: list[list[float]]
    farthest: float
    members: list[Member]
    origin: dict[str, str | int]


@cache
def weights() -> Weights:
    """Return the weights that come with the package."""
    return msgspec.json.decode(Path(__file__).with_name("weights.json").read_bytes(), type=Weights)


def first_guess(experiment: Experiment, choices: Choices | None = None) -> Guess:
    """Return a first guess of what the plain model of a pad misses.

    Raises
    ------
    NoFiniteForceError
        The plain model has no finite force in these tests.
    """
    responses = responses_of(experiment, choices)
    return guessed(experiment.pad, features_of(responses), weights())


def guessed(pad: str, features: GuessFeatures, learnt: Weights) -> Guess:
    """Return the guess that some weights give at the features of a pad."""
    if unlike := unlikeness(features.common, learnt):
        return Guess(pad, {}, None, None, unlike)
    rows = standardised(features.rows, learnt.mean, learnt.sd)
    record = rows[0, -len(COMMON) :]
    effects = np.array([_of_effects(m, features.effects, rows) for m in learnt.members])
    nothing = np.array([_logistic(m.nothing, record) for m in learnt.members])
    unlisted = np.array([_logistic(m.unlisted, record) for m in learnt.members])
    order = np.argsort(-effects.mean(axis=0), kind="stable")
    return Guess(
        pad,
        {features.effects[k]: _likely(effects[:, k]) for k in order},
        _likely(nothing),
        _likely(unlisted),
    )


def standardised(features: Array, mean: Sequence[float], sd: Sequence[float]) -> Array:
    """Return features (..., F) in sds from their means; what is beyond three counts as three."""
    return np.clip((features - np.array(mean)) / np.array(sd), -_FARTHEST, _FARTHEST)


def unlikeness(common: Array, learnt: Weights) -> str:
    """Return how much farther than those learnt from a record is; empty where it is not."""
    count = len(COMMON)
    z = (common - np.array(learnt.mean[-count:])) / np.array(learnt.sd[-count:])
    distance = float(np.sqrt(z @ np.array(learnt.precision) @ z))
    ratio = distance / learnt.farthest
    return f"{ratio:.2g} times as far from their mean as is allowed" if ratio > 1.0 else ""


def _of_effects(member: Member, names: tuple[str, ...], rows: Array) -> Array:
    bias = np.array([member.bias.get(name, 0.0) for name in names])
    return _logistic(member.effects, rows, bias)


def _logistic(weights: list[float], z: Array, bias: Array | float = 0.0) -> Array:
    """Return probabilities at standardised features (..., F); the constant is the first weight."""
    return np.asarray(1.0 / (1.0 + np.exp(-weights[0] - bias - z @ np.array(weights[1:]))))


def _likely(some: Array) -> Likely:
    return Likely(float(some.mean()), float(some.min()), float(some.max()))
