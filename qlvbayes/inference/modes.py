"""Find modes of a hypothesis's posterior by damped Gauss-Newton steps within bounds.

A search starts from one point or from many.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

from qlvbayes.inference.density import Density, Point, Terms
from qlvbayes.inference.forward.hypothesis import Hypothesis
from qlvbayes.io.arrays import Array

_STEPS = 60
_MIN_GAIN = 0.02  # predicted rise of the log density of a step at which a search has converged
_ROUGH_GAIN = 0.2  # the same under coarse noise, which only leads to a neighbourhood
_CREEP = 0.02  # rise in a step below which a search along a ridge ends
_PATIENCE = 30  # steps without a lower loss after which a search ends: far from the data each step
# falls under its own separation of the discrepancy, but may rise under the next one
_NEED = 0.02  # both, as a share of the distance to the best loss: poor modes need no accuracy
_LONGEST = 3.0  # natural lengths that a step may have
_DAMPING = (1e-3, 1e-4, 1e9)  # first, smallest, largest
_FOLLOWED = 10.0  # loss above the best under coarse noise up to which a mode is followed
_SPREAD = 4.0  # squared sds per parameter within which a search ends at a known mode
_SAME = 0.5  # difference of loss within which two modes count as one


@dataclass(frozen=True, eq=False)
class Mode:
    """The point where an optimisation ended, the size of the discrepancy (N) and the loss there."""

    point: Point
    size: float
    loss: float
    converged: bool  # whether no further step was expected to gain enough
    steps: int  # how many were tried
    curvature: Array  # (F, F): of minus the log density there


def find_mode(
    density: Density,
    hypothesis: Hypothesis,
    start: Array | Point,
    best: float = np.inf,
    min_gain: float = _MIN_GAIN,
    known: Sequence[Mode] = (),
    guess: float = 0.0,
) -> Mode | None:
    """Return the mode to which damped Gauss-Newton steps lead, or None if the start is not finite.

    The steps follow Levenberg (1944, doi:10.1090/qam/10666) and Marquardt (1963,
    doi:10.1137/0111030), until one gains less than ``min_gain`` of log density. After each
    convergence the discrepancy takes its likeliest size, until that stays the same. A mode far
    above the loss ``best`` is located less exactly; a known one is returned once the search enters
    its neighbourhood. ``guess`` (N) is near the discrepancy's likeliest size, if known.
    """
    point = start if isinstance(start, Point) else density.at(hypothesis, start)
    if point is None:
        return None
    size = density.likeliest_size(point, guess)
    terms = density.terms(point, size)
    damping, least, largest = _DAMPING
    steps, stalled = 0, False
    lowest = point, terms, steps
    for steps in range(1, _STEPS + 1):
        if terms.loss < lowest[1].loss - _CREEP:
            lowest = point, terms, steps
        elif steps >= lowest[2] + _PATIENCE:
            stalled, (point, terms, _) = True, lowest
        step = bounded_step(terms, damping, point)
        expected = predicted_decrease(terms, step)
        # where the misfit is far above the noise, a gain counts over the misfit's own scale
        excess = max(1.0, 2.0 * terms.loss / point.residual.size)
        least_rise = max(min_gain * excess, _NEED * (terms.loss - best))
        if stalled or (expected < least_rise and damping <= 1.0):
            likeliest, settled = density.likeliest(point, size)
            if likeliest == size and settled.separation.scatter == point.separation.scatter:
                return Mode(point, size, terms.loss, True, steps, terms.curvature)
            size, point, damping, stalled = likeliest, settled, _DAMPING[0], False
            terms = density.terms(point, size)
            lowest = point, terms, steps
            continue
        if steps > 1 and (reached := _known_nearby(point, terms.loss, known)):
            return reached
        # a step keeps the separation of the discrepancy, so that both losses are of one function
        separation = point.separation
        theta = point.own.within(point.theta + step)
        candidate = density.at(hypothesis, theta, separation)
        rise = terms.loss - density.loss(candidate, size, separation) if candidate else -np.inf
        if candidate is None or not rise > 0.0:
            damping *= 10.0
            stalled = damping > largest
            continue
        gain = rise / max(expected, 1e-300)
        damping = max(damping * (0.1 if gain > 0.5 else 1.0 if gain > 0.1 else 4.0), least)
        point, terms = candidate, density.terms(candidate, size)
        stalled = max(rise, 0.2 * expected) < max(_CREEP * excess, least_rise)
    size, point = density.likeliest(point, size)
    terms = density.terms(point, size)
    return Mode(point, size, terms.loss, False, steps, terms.curvature)


def _known_nearby(point: Point, loss: float, known: Sequence[Mode]) -> Mode | None:
    """Return the known mode near which a point lies at a similar height, or None."""
    for mode in known:
        gap = point.theta - mode.point.theta
        distance = gap @ mode.curvature @ gap
        if distance < _SPREAD * gap.size and loss < mode.loss + _SPREAD * gap.size:
            return mode
    return None


def find_modes(
    density: Density,
    hypothesis: Hypothesis,
    start: Array | Point,
    best: float = np.inf,
    known: Sequence[Mode] = (),
    guess: float = 0.0,
) -> list[Mode]:
    """Return [mode] if a start leads to a mode that is not known yet, else []; see `find_mode`."""
    mode = find_mode(density, hypothesis, start, best, known=known, guess=guess)
    return [] if mode is None or mode in known else [mode]


def modes(
    density: Density,
    hypothesis: Hypothesis,
    starts: Iterable[Array],
    best: float = np.inf,
    max_modes: int = 3,
    guess: float = 0.0,
    known: Sequence[Mode] = (),
) -> list[Mode]:
    """Return distinct modes that starts (F,) lead to and that are not known yet, highest first.

    Each start first leads to a mode under coarse noise, where modes are few and wide; up to
    ``max_modes`` of these that come near the highest, and are none of the known ones, are followed.
    A search that ended before it converged leaves no known mode.
    """
    ended = [_under_coarse_noise(density, mode) for mode in known if mode.converged]
    before = [one for one in ended if one is not None]
    rough = list(before)
    for start in starts:
        least = min((mode.loss for mode in rough), default=np.inf)
        mode = find_mode(density.coarse, hypothesis, start, least, _ROUGH_GAIN, rough)
        rough += [mode] if mode is not None and mode not in rough else []
    apart = distinct(rough)
    new = [mode for mode in apart if mode not in before]
    sharp: list[Mode] = []
    for candidate in new[:max_modes]:
        # under less noise it would be even farther behind
        if candidate.loss > apart[0].loss + _FOLLOWED:
            break
        theta = candidate.point.theta
        sharp += find_modes(density, hypothesis, theta, best, [*known, *sharp], guess)
    return distinct(sharp)


def _under_coarse_noise(density: Density, mode: Mode) -> Mode | None:
    """Return a mode with its loss and curvature under coarse noise."""
    point = density.coarse.at(mode.point.own.hypothesis, mode.point.theta)
    if point is None:
        return None
    terms = density.coarse.terms(point, 0.0)
    return Mode(point, 0.0, terms.loss, mode.converged, 0, terms.curvature)


def redrawn_modes(
    density: Density, hypothesis: Hypothesis, initial: Sequence[Mode], seed: int, draws: int
) -> list[Mode]:
    """Return initial modes and those found by redrawing the best one's relaxation, best first.

    As many ``draws`` at once are starts, until they lead to no higher mode.
    """
    known = list(initial)
    indices = density.space.indices_of(hypothesis, "relaxation")
    drawn = density.space.prior_draws(hypothesis, seed)[:, indices]
    for first in range(0, len(drawn), draws):
        best, some = known[0], drawn[first : first + draws]
        starts = np.tile(best.point.theta, (len(some), 1))
        starts[:, indices] = some
        new = modes(density, hypothesis, starts, best.loss, 1, best.size, known)
        known = distinct([*known, *new])
        if not known[0].loss < best.loss - _SAME:
            break
    return known


def base_modes(
    density: Density, hypothesis: Hypothesis, starts: Iterable[Array], seed: int, more: int
) -> list[Mode]:
    """Return modes from starts and from ``more`` draws of the relaxation at once, highest first."""
    initial = modes(density, hypothesis, starts)
    return redrawn_modes(density, hypothesis, initial, seed, more) if initial else []


def distinct(candidates: Iterable[Mode]) -> list[Mode]:
    """Return the modes sorted by height, the highest first, one of each group of duplicates."""
    kept: list[Mode] = []
    for mode in sorted(candidates, key=lambda m: m.loss):
        if not any(_is_duplicate(mode, other) for other in kept):
            kept.append(mode)
    return kept


def _is_duplicate(one: Mode, two: Mode) -> bool:
    """Return whether two modes have equal heights and hardly differ in terms of the curvature."""
    if abs(one.loss - two.loss) > _SAME:
        return False
    gap = one.point.theta - two.point.theta
    curvature = one.point.jacobian @ one.point.jacobian.T + one.point.prior.curvature
    return bool(gap @ curvature @ gap < 1e3 or np.allclose(gap, 0.0, atol=1e-3))


def predicted_decrease(terms: Terms, step: Array) -> float:
    """Return by how much the quadratic expansion predicts that a step (F,) reduces the loss."""
    return -float(terms.gradient @ step + 0.5 * step @ terms.curvature @ step)


def bounded_step(terms: Terms, damping: float, point: Point) -> Array:
    """Return the damped step (F,) that minimises the quadratic expansion within the bounds."""
    parameters, curvature = point.own, terms.curvature
    diagonal = np.maximum(np.diag(curvature), 1e-8 * np.diag(curvature).max())
    scale = 1.0 / np.sqrt(diagonal)
    matrix = curvature * np.outer(scale, scale) + damping * np.eye(scale.size)
    values, axes = np.linalg.eigh(matrix)
    root = np.sqrt(np.maximum(values, 1e-13))
    target = -(axes.T @ (terms.gradient * scale)) / root
    below, above = parameters.lowest - point.theta, parameters.highest - point.theta
    step = np.asarray(scale * (axes @ (target / root)))
    if not np.all((below <= step) & (step <= above)):
        bounds = (below / scale, above / scale)
        solution = lsq_linear(root[:, None] * axes.T, target, bounds, method="bvls")
        step = np.clip(scale * solution.x, below, above)
    return step * min(1.0, _LONGEST / max(float(np.max(np.abs(step) / parameters.length)), 1e-300))
