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
from qlvbayes.motion.record import RateErrors, held
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
class _Read:
    """Readings at times (n,) in s, their distance (n,) from the fitted path, their sd, the path."""

    time: Array
    off: Array
    sd: float
    path: Trajectory

    def accelerations(self, nodes: Array) -> tuple[Array, Array, Array]:
        """Return the acceleration (m,) about each node by the path, by the readings, and its sd."""
        step = np.diff(nodes)
        middle = 0.5 * (step[1:] + step[:-1])
        fitted, off = (
            np.pad(np.diff(np.diff(x) / step) / middle, 1)
            for x in (self.path.displacement(nodes), self.off[np.searchsorted(self.time, nodes)])
        )
        one, two = 1.0 / step[:-1], 1.0 / step[1:]
        noise = self.sd * np.sqrt(one**2 + two**2 + (one + two) ** 2) / middle
        return fitted, fitted + off, np.pad(noise, 1, mode="edge")


def path_errors(time: Array, displacement: Array, path: Trajectory, grid: Array) -> RateErrors:
    """Return independent errors of a motion on a grid (N,), one sd each, by readings (n,)."""
    off = displacement - path.displacement(time)
    least = _EXACT * float(np.ptp(displacement))
    sd = float(np.sqrt(max(path.resolution**2 / 12.0, float(np.mean(off**2)), least**2)))
    read = _Read(time, off, sd, path)
    parts = _unresolved(read) if sd > 0.0 else []
    errors = [_errors_in(read, nodes, changes, grid) for nodes, changes in parts]
    every = np.concatenate([np.zeros((0, 2, grid.size)), *errors])
    return RateErrors(held(every[:, 0]), held(every[:, 1]))


def _unresolved(read: _Read) -> list[tuple[Array, Array]]:
    """Return nodes (m,) of stretches where the acceleration changes between readings, and how."""
    nodes = _nodes(read)
    if nodes.size == 0:
        return []
    fitted, seen, noise = read.accelerations(nodes)
    least = _SHOWN * float(np.max(np.abs(seen)))
    by_fit, by_readings = _changes(fitted), _changes(seen)
    marked = (by_fit > least) | (by_readings > np.maximum(least, 2.0 * _SURE * noise))
    if read.path.higher is not None:  # a smooth curve follows what changes, but for its kinks
        after = np.searchsorted(nodes, read.path.kinks)
        marked &= np.isin(np.arange(nodes.size), np.concatenate([after - 1, after]))
    marked |= np.abs(seen - fitted) > np.maximum(least, _SURE * noise)
    near = np.convolve(marked, np.ones(2 * _BEYOND + 1), mode="same") > 0.0
    edges = np.flatnonzero(np.diff(np.concatenate([[False], near, [False]])))
    changes = np.maximum(by_fit, by_readings)
    return [
        (nodes[begin:end], changes[begin:end])
        for first, stop in edges.reshape(-1, 2).tolist()
        for begin in range(first, stop - 1, _LONGEST)
        for end in [min(begin + _LONGEST + 1, stop)]  # the next one begins where it ends
        if np.any(changes[begin:end] > 0.0)  # the rest of a long one may have no change
    ]


def _nodes(read: _Read) -> Array:
    """Return readings' times (m,), as near to each other as their second differences allow."""
    time, apart = read.time, float(np.median(np.diff(read.time)))
    while True:
        kept = [0]
        ahead = np.searchsorted(time, time + (1.0 - _EXACT) * apart).tolist()
        while (following := max(ahead[kept[-1]], kept[-1] + 1)) < time.size:
            kept.append(following)
        nodes = time[kept]
        if nodes.size <= 2 * _BEYOND:
            return nodes[:0]
        _, seen, noise = read.accelerations(nodes)
        if np.max(np.abs(seen) / noise) > _RESOLVED:
            return nodes
        apart *= 2.0


def _changes(acceleration: Array) -> Array:
    """Return by how much an acceleration (m,) differs from either neighbour, at most."""
    step = np.abs(np.diff(acceleration))
    return np.maximum(np.append(0.0, step), np.append(step, 0.0))


def _errors_in(read: _Read, nodes: Array, changes: Array, grid: Array) -> Array:
    """Return the errors (J, 2, N) of velocity and acceleration that one stretch contributes."""
    path, (begin, end), last = read.path, nodes[[0, -1]], nodes[-1:]
    motion = (path.displacement, path.velocity, path.acceleration)
    level, speed, rate = (float(x(begin)) for x in motion)
    # sds (2, 2) of the fitted velocity and acceleration at both ends of the stretch
    known = _KNOWN * np.max(changes) * np.array([[np.min(np.diff(nodes))], [1.0]])
    beyond = np.repeat(known, 2, axis=1)
    if path.error is not None:
        at = [np.interp([begin, end], path.error.time, x) for x in
              (path.error.velocity, path.error.acceleration)]  # fmt: skip
        # beside a part that is not known at all, nor is what lies between
        unknown = np.where(np.isnan(at), np.inf, at)
        beyond = np.clip(unknown, known, known / _KNOWN)
    size = np.repeat(np.maximum(changes[:-1], changes[1:]), _STEPS) / np.sqrt(_STEPS)
    sds = np.concatenate([[read.sd], beyond[:, 0], size])
    rows = slice(np.searchsorted(read.time, begin), np.searchsorted(read.time, end) + 1)
    time = read.time[rows]
    design = np.concatenate([_walk(nodes, k, x) for k, x in enumerate((time, last, last))])
    values = np.concatenate([
        path.displacement(time) + read.off[rows] - level - speed * (time - begin),
        path.velocity(last) - speed, path.acceleration(last),
    ])  # fmt: skip
    errors = np.concatenate([np.full(time.size, read.sd), beyond[:, 1]])
    left, gains, right = np.linalg.svd(design * sds / errors[:, None])
    narrower = np.ones(sds.size)
    narrower[: gains.size] = 1.0 / np.hypot(1.0, gains)
    seen = left.T @ ((values - design[:, 2] * rate) / errors)
    shift = gains * narrower[: gains.size] ** 2 * seen[: gains.size]
    mean = sds * (right[: gains.size].T @ shift)
    mean[2] += rate
    inside = (grid >= begin) & (grid <= end)
    on = grid[inside]
    of_grid = np.stack([_walk(nodes, 1, on), _walk(nodes, 2, on)])
    wrong = of_grid @ mean - np.stack([path.velocity(on) - speed, path.acceleration(on)])
    spread = of_grid @ (sds[:, None] * right.T * narrower)
    every = np.concatenate([wrong[..., None], spread], axis=2)
    few = _largest(np.moveaxis(every, 2, 0))
    whole = np.zeros((len(few), 2, grid.size))
    whole[:, :, inside] = few
    return whole


def _walk(nodes: Array, order: int, at: Array) -> Array:
    """Return what a derivative at times (n,) is by what the walk begins with and each step.

    The acceleration rises linearly in each of several steps from each node (m,) to the next.
    """
    length = np.repeat(np.diff(nodes) / _STEPS, _STEPS)
    begin = np.repeat(nodes[:-1], _STEPS) + length * np.resize(np.arange(_STEPS), length.size)
    since, zero, one = at - nodes[0], np.zeros(at.size), np.ones(at.size)
    first = [(one, since, 0.5 * since**2), (zero, one, since), (zero, zero, one)][order]
    u = np.maximum((at[:, None] - begin) / length, 0.0)
    rising = np.minimum(u, 1.0)
    past = u - rising
    steps = [
        length**2 * (rising**3 / 6.0 + 0.5 * past * (past + 1.0)),
        length * (0.5 * rising**2 + past),
        rising,
    ]
    return np.column_stack([*first, steps[order]])


def _largest(errors: Array) -> Array:
    """Return few errors (J, 2, G) that have nearly the second moment of many (K, 2, G)."""
    sizes = np.abs(errors).max(axis=(0, 2), initial=0.0)[:, None]
    if not np.all(sizes > 0.0):
        return errors[:0]
    scaled = errors / sizes
    _, singular, rows = np.linalg.svd(scaled.reshape(len(errors), -1), full_matrices=False)
    power = np.cumsum(singular**2)
    count = min(int(np.searchsorted(power, _KEPT * power[-1])) + 1, _MOST)
    few = (singular[:count, None] * rows[:count]).reshape(count, *errors.shape[1:])
    whole, kept = (np.sum(some**2, axis=0) for some in (scaled, few))
    ratio = np.divide(whole, kept, out=np.ones_like(kept), where=kept > 0.1 * whole)
    noticed = whole > _SMALL**2 * whole.max(axis=1, keepdims=True)
    return np.asarray(few * np.sqrt(ratio) * sizes * noticed)
