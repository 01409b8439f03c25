"""What this protocol can see: before any ranking, from the sensitivities alone."""

from __future__ import annotations

import math
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np

from qlvbayes.diagnosis.screen import Score, at_null
from qlvbayes.effects.effect import Protocol
from qlvbayes.inference.gaussnewton import (
    Point,
    judge,
    noise_along,
    pad_directions,
    predict_along,
)
from qlvbayes.inference.linearised import whitened
from qlvbayes.inference.subset import Ensemble

SEEN = 10.0  # expected 2 ln(Bayes factor) from which an effect counts as visible
TOO_ALIKE = "too small here, or too much like a change of the constants"
_FREE_RIDE = 0.15  # share of an effect's sensitivity that is left once the constants are refitted
_LEAST_BEND = 0.01  # relative change of a constant that is worth a word
_COINCIDE = 0.98  # correlation of two effects' sensitivities


@dataclass(frozen=True)
class Unseen:
    """An effect that these tests cannot show, and why."""

    effect: str
    reason: str


@dataclass(frozen=True)
class Bend:
    """An effect that hides by bending the constants.

    size: value of its amplitude; unit kind; left: share of its force that the constants do not
    take; changes: relative change of each constant if it were there and left out; visible: whether
    these tests would show it at that size all the same.
    """

    effect: str
    amplitude: str
    size: float
    left: float
    changes: dict[str, float]
    visible: bool


def expected_evidence(score: Score) -> float:
    """Expected 2 ln(Bayes factor) of the effect at one prior sd: a few per cent of the peak."""
    information = score.information * float(score.prior.sd) ** 2
    return information - math.log1p(information)


def finite_evidence(ensemble: Ensemble, point: Point, score: Score) -> float:
    """The same from the force of the effect at one prior sd, for one that has no slope at its null.

    What the constants can take of the difference is left out.
    """
    constants = at_null(ensemble, point, score.theta, [score.effect])
    moved = constants.copy()
    moved[ensemble.amplitude(score.effect)] = float(score.prior.sd)
    directions = pad_directions(point.slopes.T)
    before, slopes = predict_along(ensemble, constants, directions)
    after, _ = predict_along(ensemble, moved, np.zeros_like(directions))
    noise, _ = noise_along(ensemble.posterior.noise, constants, directions)
    vectors = np.concatenate([(after - before)[None], slopes])
    white = np.asarray(whitened(noise, ensemble.posterior.record, jnp.asarray(vectors)))
    white = white.reshape(len(white), -1)
    change, own = white[0], white[1 : 1 + point.gradient.size]
    taken = own @ change
    gain = float(change @ change - taken @ np.linalg.solve(point.curvature, taken))
    return max(gain, 0.0) - math.log1p(max(gain, 0.0))


def unseen(
    ensemble: Ensemble, point: Point, scores: dict[str, list[Score]], protocol: Protocol
) -> list[Unseen]:
    """Effects whose expected evidence at a plausible size is below 10 at every shape, and why."""
    found = []
    for effect, tried in scores.items():
        best = max(tried, key=expected_evidence)
        value = expected_evidence(best)
        if best.information == 0.0:
            value = finite_evidence(ensemble, point, best)
        if value >= SEEN:
            continue
        reason = type(ensemble.effect(effect)).blind(protocol) or (
            f"{TOO_ALIKE} (2 ln Bayes factor {value:.1f} expected at 5 % of the peak force)"
        )
        found.append(Unseen(effect, reason))
    return found


def unmeasured(ensemble: Ensemble, protocol: Protocol) -> list[Unseen]:
    """Candidates made of a velocity or an acceleration that the displacement records do not give.

    They are not tried: what is fitted in their place is the records' error.
    """
    reasons = {
        name: type(ensemble.effect(name)).unmeasured(protocol) for name in ensemble.candidates
    }
    return [Unseen(name, reason) for name, reason in reasons.items() if reason is not None]


def bends(ensemble: Ensemble, point: Point, scores: dict[str, list[Score]]) -> list[Bend]:
    """Effects of which the constants take nearly all, and what that would do to each constant."""
    names = ensemble.names
    noise = {name for name in names if name.startswith("noise.")}
    found = []
    for effect, tried in scores.items():
        score = max(tried, key=expected_evidence)
        if score.total <= 0.0 or score.information <= 0.0:
            continue
        left = math.sqrt(score.information / score.total)
        if left > _FREE_RIDE:
            continue
        size = float(score.prior.sd)
        change = -point.slopes @ score.shift * size
        changes = {
            name: float(delta / value)
            for name, delta, value in zip(names, change, point.constants, strict=True)
            if name not in noise and value and abs(delta / value) > _LEAST_BEND
        }
        if changes:
            amplitude = names[ensemble.amplitude(effect)]
            seen = expected_evidence(score) >= SEEN
            found.append(Bend(effect, amplitude, size, left, changes, seen))
    return found


def coincident(
    ensemble: Ensemble, point: Point, scores: dict[str, list[Score]]
) -> list[tuple[str, ...]]:
    """Groups of effects whose visible parts have the same shape (correlation above 0.98)."""
    effects = [effect for effect, tried in scores.items() if tried[0].information > 0.0]
    if len(effects) < 2:
        return []
    amplitudes = [ensemble.amplitude(effect) for effect in effects]
    directions = np.concatenate([point.slopes.T, np.eye(point.constants.size)[amplitudes]])
    constants = point.constants
    judged = judge(ensemble, constants, directions)
    free = point.gradient.size
    matrix = np.asarray(judged.information).sum(axis=0)[: len(directions), : len(directions)]
    cross = matrix[free:, :free]
    rest = matrix[free:, free:] - cross @ np.linalg.solve(point.curvature, cross.T)
    size = np.sqrt(np.maximum(np.diag(rest), 0.0))
    alike = np.abs(rest) > _COINCIDE * np.outer(size, size)
    return _groups(effects, alike)


def _groups(effects: list[str], alike: np.ndarray) -> list[tuple[str, ...]]:
    groups: list[tuple[str, ...]] = []
    taken: set[str] = set()
    for k in range(len(effects)):
        members = tuple(e for e, same in zip(effects, alike[k], strict=True) if same)
        if len(members) > 1 and not taken & set(members):
            groups.append(members)
            taken |= set(members)
    return groups
