r"""Errors of a fitted motion's speed and acceleration, where readings do not resolve their change.

Within such a stretch the acceleration is a random walk from the fitted one at its beginning, as
large over an interval as the readings and the fit make it change there,

.. math:: a(t) = a_0 + \sum_k w_k\,r(t - s_k)

with r rising from 0 to 1 until the next s_k. Given the readings, and the fitted speed and
acceleration beyond the stretch, each with its error, the w_k are jointly normal, with a mean, which
the fit has wrong there, and a covariance: a few outer products.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from qlvbayes.io.arrays import Array
from qlvbayes.motion.trajectory import Trajectory

_RESOLVED = 15.0  # sds of the largest acceleration that readings resolve
_SURE = 4.0  # sds of an acceleration that is no error of the readings
_SHOWN = 0.03  # of the largest acceleration: what changes by less between two readings is resolved
_STEPS = 4  # of the walk between two nodes
_BEYOND = 2  # nodes on either side of a change that tell it apart
_LONGEST = 40  # nodes of a stretch that is treated as one
_KEPT = 0.998  # share of the second moment that outer products keep,
_MOST = 12  # of which a stretch has so many at most
_SMALL = 0.01  # of the largest sd in a stretch: less is none
_KNOWN = 1e-3  # of the changes in a stretch: speed and acceleration beyond it are known no better
_EXACT = 1e-6  # of the range: no reading is better


@dataclass(frozen=True)
class PathErrors:
    """Errors (E, N) of velocity and acceleration on a grid of times, one standard deviation each.

    They are independent from row to row.
    """

    velocity: Array
    acceleration: Array


@dataclass(frozen=True)
class _Read:
    """Readings at times (n,) in s, their distance (n,) from the fitted path, their sd, the path."""

    time: Array
    off: Array
    sd: float
    path: Trajectory


def path_errors(time: Array, displacement: Array, path: Trajectory, grid: Array) -> PathErrors:
    """Return the errors of a fitted motion at times (N,), from its readings (n,) at times (n,)."""
    off = displacement - path.displacement(time)
    least = _EXACT * float(np.ptp(displacement))
    sd = float(np.sqrt(max(path.resolution**2 / 12.0, float(np.mean(off**2)), least**2)))
    read = _Read(time, off, sd, path)
    parts = _unresolved(read) if sd > 0.0 else []
    errors = [_errors_in(read, nodes, changes, grid) for nodes, changes in parts]
    every = np.concatenate([np.zeros((0, 2, grid.size)), *errors])
    return PathErrors(every[:, 0], every[:, 1])


def _unresolved(read: _Read) -> list[tuple[Array, Array]]:
    """Return nodes (m,) of stretches in which the acceleration changes between readings."""
    nodes = _nodes(read)
    if nodes.size == 0:
        return []
    fitted, seen, noise = _accelerations(read, nodes)
    least = _SHOWN * float(np.max(np.abs(seen)))
    by_fit, by_readings = _changes(fitted), _changes(seen)
    marked = (by_fit > least) | (by_readings > np.maximum(least, 2.0 * _SURE * noise))
    marked |= np.abs(seen - fitted) > np.maximum(least, _SURE * noise)
    near = np.convolve(marked, np.ones(2 * _BEYOND + 1), mode="same") > 0.0
    edges = np.flatnonzero(np.diff(np.concatenate([[False], near, [False]])))
    changes, parts = np.maximum(by_fit, by_readings), []
    for first, stop in edges.reshape(-1, 2).tolist():
        for begin in range(first, stop - 1, _LONGEST):
            here = slice(
                begin, min(begin + _LONGEST + 1, stop)
            )  # the next one begins where it ends
            parts.append((nodes[here], changes[here]))
    return parts


def _nodes(read: _Read) -> Array:
    """Return readings' times (m,), as near to each other as their second differences allow."""
    apart = float(np.median(np.diff(read.time)))
    while (nodes := _spaced(read.time, apart)).size > 2 * _BEYOND:
        _, seen, noise = _accelerations(read, nodes)
        if np.max(np.abs(seen) / noise) > _RESOLVED:
            return nodes
        apart *= 2.0
    return nodes[:0]


def _spaced(time: Array, apart: float) -> Array:
    """Return those times (m,) that are at least so far (s) from the one before."""
    kept = [0]
    ahead = np.searchsorted(time, time + (1.0 - _EXACT) * apart).tolist()
    while (following := max(ahead[kept[-1]], kept[-1] + 1)) < time.size:
        kept.append(following)
    return time[kept]


def _accelerations(read: _Read, nodes: Array) -> tuple[Array, Array, Array]:
    """Return the acceleration (m,) about each node by the path, by the readings, and its sd."""
    step = np.diff(nodes)
    middle = 0.5 * (step[1:] + step[:-1])

    def second(x: Array) -> Array:
        return np.pad(np.diff(np.diff(x) / step) / middle, 1)

    fitted = second(read.path.displacement(nodes))
    off = second(read.off[np.searchsorted(read.time, nodes)])
    one, two = 1.0 / step[:-1], 1.0 / step[1:]
    noise = read.sd * np.sqrt(one**2 + two**2 + (one + two) ** 2) / middle
    return fitted, fitted + off, np.pad(noise, 1, mode="edge")


def _changes(acceleration: Array) -> Array:
    """Return by how much an acceleration (m,) differs from either neighbour, at most."""
    step = np.abs(np.diff(acceleration))
    return np.maximum(np.append(0.0, step), np.append(step, 0.0))


def _errors_in(read: _Read, nodes: Array, changes: Array, grid: Array) -> Array:
    """Return the errors (J, 2, N) of velocity and acceleration that one stretch contributes."""
    path, walk = read.path, _Walk.between(nodes)
    begin, end = float(nodes[0]), float(nodes[-1])
    level, speed, rate = (
        float(x(begin)) for x in (path.displacement, path.velocity, path.acceleration)
    )
    beyond = _sds(read, nodes, float(np.max(changes)))
    size = np.repeat(np.maximum(changes[:-1], changes[1:]), _STEPS) / np.sqrt(_STEPS)
    sds = np.concatenate([[read.sd], beyond[:, 0], size])
    rows = slice(np.searchsorted(read.time, begin), np.searchsorted(read.time, end) + 1)
    time, last = read.time[rows], nodes[-1:]
    design = np.concatenate([walk.of(0, time), walk.of(1, last), walk.of(2, last)])
    known = np.concatenate([
        path.displacement(time) + read.off[rows] - level - speed * (time - begin),
        path.velocity(last) - speed, path.acceleration(last),
    ])  # fmt: skip
    errors = np.concatenate([np.full(time.size, read.sd), beyond[:, 1]])
    known = (known - design[:, 2] * rate) / errors
    left, gains, right = np.linalg.svd(design * sds / errors[:, None])
    count = gains.size
    narrower = np.ones(sds.size)
    narrower[:count] = 1.0 / np.hypot(1.0, gains)
    mean = sds * (right[:count].T @ (gains * narrower[:count] ** 2 * (left.T @ known)[:count]))
    mean[2] += rate
    spread = sds[:, None] * right.T * narrower
    inside = (grid >= begin) & (grid <= end)
    on = grid[inside]
    of_grid = np.stack([walk.of(1, on), walk.of(2, on)])
    wrong = of_grid @ mean - np.stack([path.velocity(on) - speed, path.acceleration(on)])
    every = np.concatenate([wrong[..., None], of_grid @ spread], axis=2)
    few = _largest(np.moveaxis(every, 2, 0))
    whole = np.zeros((len(few), 2, grid.size))
    whole[:, :, inside] = few
    return whole


@dataclass(frozen=True)
class _Walk:
    """An acceleration that rises linearly from each of K times (s) to the next."""

    begin: Array
    length: Array

    @classmethod
    def between(cls, nodes: Array) -> _Walk:
        """Return a walk of several steps from each node (m,) to the next."""
        length = np.repeat(np.diff(nodes) / _STEPS, _STEPS)
        return cls(
            np.repeat(nodes[:-1], _STEPS) + length * np.resize(np.arange(_STEPS), length.size),
            length,
        )

    def of(self, order: int, at: Array) -> Array:
        """Return what a derivative at times (n,) is by what it begins with and each step."""
        since = at - self.begin[0]
        zero, one = np.zeros(at.size), np.ones(at.size)
        first = [(one, since, 0.5 * since**2), (zero, one, since), (zero, zero, one)][order]
        u = np.maximum((at[:, None] - self.begin) / self.length, 0.0)
        rising = np.minimum(u, 1.0)
        past = u - rising
        if order == 2:
            steps = rising
        elif order == 1:
            steps = self.length * (0.5 * rising**2 + past)
        else:
            steps = self.length**2 * (rising**3 / 6.0 + 0.5 * past * (past + 1.0))
        return np.column_stack([*first, steps])


def _sds(read: _Read, nodes: Array, most: float) -> Array:
    """Return the sds (2, 2) of the fitted velocity and acceleration at both ends of a stretch."""
    width = float(np.min(np.diff(nodes)))
    least = _KNOWN * most * np.array([[width], [1.0]])
    error, ends = read.path.error, nodes[[0, -1]]
    if error is None:
        return np.repeat(least, 2, axis=1)
    sds = np.stack([np.interp(ends, error.time, x) for x in (error.velocity, error.acceleration)])
    return np.asarray(np.clip(sds, least, least / _KNOWN))


def _largest(errors: Array) -> Array:
    """Return few errors (J, 2, G) that have nearly the second moment of many (K, 2, G)."""
    sizes = np.abs(errors).max(axis=(0, 2), initial=0.0)[:, None]
    if not np.all(sizes > 0.0):
        return errors[:0]
    _, singular, rows = np.linalg.svd(
        (errors / sizes).reshape(len(errors), -1), full_matrices=False
    )
    power = np.cumsum(singular**2)
    count = min(int(np.searchsorted(power, _KEPT * power[-1])) + 1, _MOST)
    few = (singular[:count, None] * rows[:count]).reshape(count, *errors.shape[1:])
    whole, kept = (np.sum(some**2, axis=0) for some in (errors / sizes, few))
    ratio = np.divide(whole, kept, out=np.ones_like(kept), where=kept > 0.1 * whole)
    noticed = whole > _SMALL**2 * whole.max(axis=1, keepdims=True)
    return np.asarray(few * np.sqrt(ratio) * sizes * noticed)
