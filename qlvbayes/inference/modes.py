"""Modes of a hypothesis: damped Gauss-Newton steps within bounds, from one start or from many."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from qlvbayes.inference.density import Density, Point, Terms
from qlvbayes.inference.forward.hypothesis import Hypothesis

Array = NDArray[np.float64]

_STEPS = 60
_ENOUGH = 0.02  # rise of the log density that a step promises, below which the mode is found
_NEARLY = 0.2  # the same under coarse noise, which only leads to a place
_CREEP = 0.02  # rise in a step, at which the way along a ridge ends
_NEED = 0.02  # both as a share of how far a place is behind the best: there no more is asked
_FARTHEST = 3.0  # longest step in a natural length
_DAMPING = (1e-3, 1e-4, 1e9)  # first, least, most
_ROUGHLY = 10.0  # loss behind the best, under coarse noise, up to which a place is followed
_SPREAD = 4.0  # of squared sds a number, within which a way ends at a mode that is known
_SAME = 0.5  # of loss, within which two modes are one


@dataclass(frozen=True, eq=False)
class Mode:
    """Where optimising ended: the point, the discrepancy's size (N) there, the loss.

    converged: whether no step promised more; steps: how many were tried.
    """

    point: Point
    size: float
    loss: float
    converged: bool
    steps: int


def find_mode(
    density: Density,
    hypothesis: Hypothesis,
    start: Array | Point,
    best: float = np.inf,
    enough: float = _ENOUGH,
    known: Sequence[Mode] = (),
) -> Mode | None:
    """Levenberg-Marquardt from theta (F,) or a point, then on at the discrepancy's likeliest size.

    best: loss of the best so far, behind which a mode is known less exactly; enough: rise of the
    log density that a step must promise; known: modes of the hypothesis, one of which is the answer
    as soon as the way leads into its neighbourhood. None: not finite.
    """
    point = start if isinstance(start, Point) else density.at(hypothesis, start)
    if point is None:
        return None
    size = density.likeliest_size(point)
    here = density.terms(point, size)
    damping, least, most = _DAMPING
    tried, over = 0, False
    for tried in range(1, _STEPS + 1):
        step = bounded_step(here, damping, point)
        promise = promised(here, step)
        least_rise = max(enough, _NEED * (here.loss - best))
        if over or (promise < least_rise and damping <= 1.0):
            likeliest = density.likeliest_size(point, size)
            if likeliest == size:
                return Mode(point, size, here.loss, True, tried)
            size, damping, over = likeliest, _DAMPING[0], False
            here = density.terms(point, size)
            continue
        if tried > 1 and (met := _met(density, point, here.loss, known)):
            return met
        found = density.at(hypothesis, point.own.within(point.theta + step))
        # the discrepancy's separation is held in a step: the objective must be one function
        rise = here.loss - density.loss(found, size, point.separation) if found else -np.inf
        if found is None or not rise > 0.0:
            damping *= 10.0
            over = damping > most
            continue
        gain = rise / max(promise, 1e-300)
        damping = max(damping * (0.1 if gain > 0.5 else 1.0 if gain > 0.1 else 4.0), least)
        point, here = found, density.terms(found, size)
        over = max(rise, 0.2 * promise) < max(_CREEP, least_rise)
    size = density.likeliest_size(point, size)
    return Mode(point, size, density.terms(point, size).loss, False, tried)


def _met(density: Density, point: Point, loss: float, known: Sequence[Mode]) -> Mode | None:
    """The known mode within whose spread a point lies, and about as high."""
    for mode in known:
        gap = point.theta - mode.point.theta
        far = gap @ density.terms(mode.point, mode.size).curvature @ gap
        if far < _SPREAD * gap.size and loss < mode.loss + _SPREAD * gap.size:
            return mode
    return None


def find_modes(
    density: Density,
    hypothesis: Hypothesis,
    start: Array | Point,
    best: float = np.inf,
    known: Sequence[Mode] = (),
) -> list[Mode]:
    """The mode that a start leads to, if it leads to one that is not known yet; see `find_mode`."""
    mode = find_mode(density, hypothesis, start, best, known=known)
    return [] if mode is None or mode in known else [mode]


def rough_mode(
    density: Density,
    hypothesis: Hypothesis,
    start: Array | Point,
    best: float = np.inf,
    known: Sequence[Mode] = (),
) -> Mode | None:
    """As `find_mode` under coarse noise, where there are few modes and wide ones."""
    return find_mode(density.coarse, hypothesis, start, best, _NEARLY, known)


def modes(
    density: Density,
    hypothesis: Hypothesis,
    starts: Iterable[Array],
    best: float = np.inf,
    most: int = 3,
) -> list[Mode]:
    """Distinct modes from many starts, the highest first.

    All are optimised under coarse noise first; the best places it leads to (at most ``most``) are
    followed under the noise itself.
    """
    rough: list[Mode] = []
    for start in starts:
        least = min((mode.loss for mode in rough), default=np.inf)
        mode = rough_mode(density, hypothesis, start, least, rough)
        rough += [mode] if mode is not None and mode not in rough else []
    found: list[Mode] = []
    places = distinct(rough)[:most]
    for place in places:
        if place.loss > places[0].loss + _ROUGHLY:  # it would fall back farther under less noise
            break
        found += find_modes(density, hypothesis, place.point.theta, best, known=found)
    return distinct(found)


def redrawn_modes(
    density: Density,
    hypothesis: Hypothesis,
    found: Sequence[Mode],
    seed: int,
    vain: int,
) -> list[Mode]:
    """Modes, the highest first: those found, and more from the best with its relaxation redrawn.

    Until ``vain`` draws of the relaxation's prior in a row lead no higher: spectra have several
    modes where other constants have one, and coarse noise cannot tell spectra apart.
    """
    known, tried = list(found), 0
    numbers = density.space.numbers_of(hypothesis, "relaxation")
    for drawn in density.space.draws_of(hypothesis, "relaxation", seed):
        start = known[0].point.theta.copy()
        start[numbers] = drawn
        mode = find_mode(density, hypothesis, start, known[0].loss, known=known)
        is_higher = mode is not None and mode.loss < known[0].loss - _SAME
        known = distinct([*known, mode]) if mode is not None else known
        tried = 0 if is_higher else tried + 1
        if tried == vain:
            break
    return known


def base_modes(
    density: Density, hypothesis: Hypothesis, seed: int, starts: int, vain: int
) -> list[Mode]:
    """Modes of a hypothesis from so many draws of its priors, then of its relaxation's alone.

    Of these until ``vain`` in a row lead no higher.
    """
    draws = density.space.plain_draws(hypothesis, seed)
    found = modes(density, hypothesis, draws[:starts])
    return redrawn_modes(density, hypothesis, found, seed, vain) if found else []


def distinct(found: Iterable[Mode]) -> list[Mode]:
    """The highest first, one of those that are alike."""
    kept: list[Mode] = []
    for mode in sorted(found, key=lambda m: m.loss):
        if not any(_alike(mode, other) for other in kept):
            kept.append(mode)
    return kept


def _alike(one: Mode, two: Mode) -> bool:
    """Whether two are one: of equal height and hardly apart by the curvature."""
    if abs(one.loss - two.loss) > _SAME:
        return False
    gap = one.point.theta - two.point.theta
    curvature = one.point.jacobian @ one.point.jacobian.T + one.point.prior.curvature
    return bool(gap @ curvature @ gap < 1e3 or np.allclose(gap, 0.0, atol=1e-3))


def promised(terms: Terms, step: Array) -> float:
    """Rise of the log density that a step (F,) promises, by slope and curvature."""
    return -float(terms.gradient @ step + 0.5 * step @ terms.curvature @ step)


def bounded_step(terms: Terms, damping: float, point: Point) -> Array:
    """A damped step (F,): to the lowest place of the quadratic within the bounds, or near it."""
    own, curvature = point.own, terms.curvature
    diagonal = np.maximum(np.diag(curvature), 1e-8 * np.diag(curvature).max())
    scale = 1.0 / np.sqrt(diagonal)
    matrix = curvature * np.outer(scale, scale) + damping * np.eye(scale.size)
    values, axes = np.linalg.eigh(matrix)
    root = np.sqrt(np.maximum(values, 1e-13))
    goal = -(axes.T @ (terms.gradient * scale)) / root
    below, above = own.lowest - point.theta, own.highest - point.theta
    step = np.asarray(scale * (axes @ (goal / root)))
    if not np.all((below <= step) & (step <= above)):
        bounds = (below / scale, above / scale)
        found = lsq_linear(root[:, None] * axes.T, goal, bounds, method="bvls")
        step = np.clip(scale * found.x, below, above)
    return step * min(1.0, _FARTHEST / max(float(np.max(np.abs(step) / own.length)), 1e-300))
