r"""The features by which a first guess tells effects apart: numbers that know no protocol.

Of each response of `responses`, amplitudes a (sds) have the prior N(0, 1), or its half above zero.
Under a discrepancy of size s the effect then has the Bayes factor

.. math:: \ln B(s) = \frac{g^2}{2 (1 + H)} - \tfrac12 \ln (1 + H)
                     + \ln 2 \Phi \Big( \frac{g}{\sqrt{1 + H}} \Big),

without the last term where the amplitude has a sign, and E = ln sum_s e^{-loss(s)} B(s) - ln sum_s
e^{-loss(s)} is its evidence in nats. An effect has the evidence of the best of its responses. Given
another effect, g and H are those beside its amplitude, which is integrated out. Evidence enters as
asinh E.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, logsumexp

from qlvbayes.effects.catalogue import EFFECTS
from qlvbayes.effects.catalogue import names as names_of
from qlvbayes.guess.responses import Responses
from qlvbayes.io.arrays import Array
from qlvbayes.motion.phases import KINDS

OWN = (
    "evidence", "beside_rival", "rival_beside", "ahead", "beside_two", "share_removed",
    "over_noise", "amplitude", "signal", "negative", "cosine",
    *(f"gain_{kind}" for kind in KINDS), "worst_test", "tests_helped",
)  # fmt: skip
"""Names of the features of one effect."""
COMMON = (
    "best", "second", "third", "unlisted", "unlisted_beside", "no_discrepancy",
    "no_discrepancy_beside", "size", "size_over_noise", "noise", "misfit", "law_gain",
    *(f"misfit_{kind}" for kind in KINDS), "tests", "readings", "unloads", "returns",
    "one_depth", "curved", "timed",
)  # fmt: skip
"""Names of the features of a record, which all its effects share."""
LISTED = frozenset(names_of(EFFECTS))
"""Names of the effects that may be named."""
_LEAST = 1e-12  # instead of a zero in a denominator
_STEPS = 3  # effects that are taken one after another


@dataclass(frozen=True, eq=False)
class GuessFeatures:
    """own (E, F): of each effect that the tests can show, by name; common (G,): of the record."""

    effects: tuple[str, ...]
    own: Array
    common: Array

    @property
    def rows(self) -> Array:
        """Return the features (E, F + G) of each effect, with those of the record."""
        return np.column_stack([self.own, np.tile(self.common, (len(self.own), 1))])


@dataclass(frozen=True, eq=False)
class Expansion:
    """Losses (S,), gradients (S, K) and curvatures (S, K, K) beside effects that were added."""

    losses: Array
    gradients: Array
    curvatures: Array
    signed: NDArray[np.bool_]

    @property
    def factors(self) -> Array:
        """Return the log Bayes factor (S, K) of each response at each size."""
        variance = 1.0 + np.diagonal(self.curvatures, axis1=1, axis2=2)
        z = self.gradients / np.sqrt(variance)
        bounded = np.where(self.signed, 0.0, math.log(2.0) + log_ndtr(z))
        return np.asarray(0.5 * z**2 - 0.5 * np.log(variance) + bounded)

    @property
    def evidence(self) -> Array:
        """Return the evidence (K,) of each response over none, in nats."""
        total = logsumexp(self.factors - self.losses[:, None], axis=0)
        return np.asarray(total - logsumexp(-self.losses))

    @property
    def none(self) -> float:
        """Return the log odds that there is no discrepancy."""
        return float(-logsumexp(self.losses[0] - self.losses[1:]))

    def given(self, k: int) -> Expansion:
        """Return the expansion given that one response is there, its amplitude integrated out."""
        column = self.curvatures[:, :, k]
        scale = 1.0 / (1.0 + column[:, k])
        gradients = self.gradients - column * (scale * self.gradients[:, k])[:, None]
        curvatures = self.curvatures - scale[:, None, None] * column[:, :, None] * column[:, None]
        return Expansion(self.losses - self.factors[:, k], gradients, curvatures, self.signed)


def features_of(r: Responses) -> GuessFeatures:
    """Return the features of a record, and of every listed effect that its tests can show."""
    family = np.array(r.families)
    names = tuple(dict.fromkeys(name for name in r.families if name in LISTED))
    alone = Expansion(r.losses, r.gradients, r.curvatures, r.signed)
    evidence = alone.evidence
    best = {name: _best(evidence, family == name) for name in names}
    order = sorted(names, key=lambda name: -evidence[best[name]])
    conditioned = {name: alone.given(best[name]) for name in names}
    h = r.curvatures[likeliest := int(np.argmin(r.losses))]
    gains = _by_block(r, [best[name] for name in names])
    own = []
    for name, gain in zip(names, gains, strict=True):
        rival, *others = (other for other in order if other != name)
        k, m = best[name], best[rival]
        second = _best(conditioned[rival].evidence, np.isin(family, others))
        after = (conditioned[rival], conditioned[name], conditioned[rival].given(second))
        of_rival, of_name = family == rival, family == name
        remaining = [
            float(one.evidence[_best(one.evidence, some)])
            for one, some in zip(after, (of_name, of_rival, of_name), strict=True)
        ]
        amplitude = r.gradients[likeliest, k] / (1.0 + h[k, k])
        toward, square = float(r.own[k] @ r.left), float(r.own[k] @ r.own[k])
        helps = 1.0 if r.signed[k] or toward > 0.0 else 0.0
        share = helps * toward**2 / max(square * float(r.left @ r.left), _LEAST)
        over_noise = helps * r.gradients[0, k] ** 2 / (1.0 + r.curvatures[0, k, k])
        by_phase = np.bincount(r.phase, gain, len(KINDS))
        by_test = np.bincount(r.test, gain)
        own.append(
            [
                *map(
                    math.asinh, (evidence[k], remaining[0], remaining[1], evidence[k] - evidence[m])
                ),
                math.asinh(remaining[2]),
                -math.log1p(-min(share, 1.0 - 1e-9)),
                math.log1p(over_noise),
                math.log(abs(amplitude) + 1e-3),
                math.log1p(h[k, k]),
                float(amplitude < 0.0),
                abs(h[k, m]) / math.sqrt(max(h[k, k] * h[m, m], _LEAST)),
                *(by_phase / max(float(np.abs(by_phase).sum()), _LEAST)).tolist(),
                float(np.abs(by_test).max()) / max(float(np.abs(by_test).sum()), _LEAST),
                float(np.mean(by_test > 0.0)),
            ]
        )
    return GuessFeatures(names, np.array(own), _common(r, alone, np.isin(family, names)))


def _best(evidence: Array, some: NDArray[np.bool_]) -> int:
    """Return the index of the largest evidence (K,) among some responses."""
    return int(np.argmax(np.where(some, evidence, -np.inf)))


def _by_block(r: Responses, rows: list[int]) -> Array:
    """Return how much the best amplitude of each response lowers the squares (E, n) of a block."""
    own = r.own[rows]
    toward = own @ r.left
    amplitude = toward / np.maximum((own**2).sum(axis=1), _LEAST)
    amplitude = np.where(r.signed[rows], amplitude, np.maximum(amplitude, 0.0))[:, None]
    return np.asarray(2.0 * amplitude * own * r.left - (amplitude * own) ** 2)


def _common(r: Responses, alone: Expansion, listed: NDArray[np.bool_]) -> Array:
    """Return the features (G,) of a record."""
    steps, now = [], alone
    for _ in range(_STEPS):
        evidence = now.evidence
        k = _best(evidence, listed)
        steps.append((float(evidence[k]), now))
        now = now.given(k)
    unlisted = [float(one.evidence[~listed].max(initial=0.0)) for _, one in steps[:2]]
    squares = (r.left / r.noise) ** 2
    readings = np.bincount(r.phase, minlength=len(KINDS))
    by_phase = np.where(readings > 0, np.bincount(r.phase, squares, len(KINDS)), 1.0)
    by_phase = np.log(np.maximum(by_phase / np.maximum(readings, 1), 1e-3))
    p = r.protocol
    return np.array(
        [
            *(math.asinh(gain) for gain, _ in steps),
            *(math.asinh(gain) for gain in unlisted),
            math.asinh(steps[0][1].none),
            math.asinh(steps[1][1].none),
            math.log(r.size / r.peak + 1e-4),
            math.log(r.size / float(np.median(r.noise)) + 1e-2),
            math.log(float(np.median(r.noise)) / r.peak),
            math.log(float(squares.mean())),
            math.asinh(max(r.laws.values(), default=0.0)),
            *by_phase.tolist(),
            math.log(p.tests),
            math.log(r.left.size),
            *(float(x) for x in (p.unloads, p.returns, p.one_depth, p.curved, p.timed)),
        ]
    )
