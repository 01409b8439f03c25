"""What this protocol can see: before any ranking, from the sensitivities alone."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from qlvbayes.diagnosis.screen import Score
from qlvbayes.effects.effect import Protocol
from qlvbayes.inference.gaussnewton import Point
from qlvbayes.inference.subset import Ensemble

SEEN = 10.0  # expected 2 ln(Bayes factor) from which an effect counts as visible
_FREE_RIDE = 0.10  # share of an effect's sensitivity that is left once the constants are refitted
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


def impossible(ensemble: Ensemble, protocol: Protocol) -> list[Unseen]:
    """Effects that this kind of protocol cannot show whatever their size."""
    found = []
    for effect in ensemble.effects:
        reason = type(effect).blind(protocol)
        if reason:
            found.append(Unseen(effect.name, reason))
    return found


def expected_evidence(score: Score) -> float:
    """Expected 2 ln(Bayes factor) of the effect at one prior sd: a few per cent of the peak."""
    sd = float(score.prior.sd)
    information = score.information * sd**2
    return information - math.log1p(information)


def invisible(scores: dict[str, list[Score]], unit_of: dict[str, str]) -> list[Unseen]:
    """Effects whose expected evidence at a plausible size is below 10 at every shape."""
    found = []
    for effect, tried in scores.items():
        best = max(tried, key=expected_evidence)
        value = expected_evidence(best)
        if value < SEEN and best.information > 0.0:
            reason = (
                f"5 % of the peak force would give 2 ln(Bayes factor) of only {value:.1f} here: "
                "its force is too small or too much like a change of the constants"
            )
            found.append(Unseen(effect, reason))
    return found


def bends(ensemble: Ensemble, point: Point, scores: dict[str, list[Score]]) -> list[Bend]:
    """Effects of which the constants take nearly all, and what that would do to each constant."""
    names = ensemble.names
    noise = {name for name in names if name.startswith("noise.")}
    found = []
    for effect, tried in scores.items():
        score = tried[0]
        if score.total <= 0.0 or score.information <= 0.0:
            continue
        left = math.sqrt(score.information / score.total)
        if left > _FREE_RIDE * 1.5:
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
    from qlvbayes.inference.gaussnewton import judge

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
    size = np.sqrt(np.maximum(np.diag(rest), 1e-300))
    alike = np.abs(rest / np.outer(size, size)) > _COINCIDE
    return _groups(effects, alike)


def _groups(effects: list[str], alike: np.ndarray) -> list[tuple[str, ...]]:
    groups: list[tuple[str, ...]] = []
    taken: set[str] = set()
    for k, effect in enumerate(effects):
        members = tuple(e for e, same in zip(effects, alike[k], strict=True) if same)
        if len(members) > 1 and not taken & set(members):
            groups.append(members)
            taken |= set(members)
    return groups
