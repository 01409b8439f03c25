r"""Compute the hereditary integral in O(N), exact for piecewise linear displacement.

A smooth motion may also give the deviation of each step's midpoint from the straight line, which is
taken into account to first order.

.. math:: F(t) = \int_0^t g(t - s)\, K(\delta(s))\, \dot\delta(s)\, ds
         = c_0 F_e(\delta(t)) + \sum_i c_i q_i(t)

Each Prony term obeys a linear recursion, q_i(t + h) = e^{-v_i h} q_i(t) + (step), whose step the
elastic law gives in closed form. The recursion is cut into chunks that are computed in parallel;
the states at the chunks' ends are then propagated from chunk to chunk. (Fung 1981; the recursion is
that of Taylor, Pister & Goudreau 1970, doi:10.1002/nme.1620020106, with the exact step in place of
their average.)
"""

from __future__ import annotations

import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from qlvbayes import xp
from qlvbayes.laws.elastic.law import AbstractElastic
from qlvbayes.laws.elastic.steps import Rise
from qlvbayes.laws.recursion import add_modes
from qlvbayes.laws.relaxation.law import AbstractRelaxation
from qlvbayes.pytree import Pytree
from qlvbayes.xp import Array

_VECTOR = 16  # numbers: two of the widest vectors of common processors
_NEAR = 0.03  # below this the series is exact to 1e-9, and the closed form loses digits


class Relaxing(Pytree):
    """State of a material: its depth (mm) and q_i (N), shape (k,) for k relaxing modes."""

    depth: Array
    parts: Array


def at_first(elastic: AbstractElastic, relaxation: AbstractRelaxation, depth: Array) -> Relaxing:
    """Return the state at a motion's first point: a step from zero depth, not relaxed yet."""
    _, rates = relaxation.spectrum()
    zero = jnp.zeros_like(depth)
    instant = elastic.force(depth)
    step = elastic.relaxed_step(zero, depth, elastic.force(zero), instant, jnp.zeros_like(rates))
    return Relaxing(depth, jnp.broadcast_to(step, rates.shape))


def hereditary_step(
    elastic: AbstractElastic,
    relaxation: AbstractRelaxation,
    state: Relaxing,
    duration: Array,
    depth: Array,
) -> tuple[Relaxing, Array]:
    """Return state and force (N) after a straight line to ``depth`` (mm) in ``duration`` (s)."""
    fractions, rates = relaxation.spectrum()
    decay = rates * duration
    before, instant = elastic.force(state.depth), elastic.force(depth)
    step = elastic.relaxed_step(state.depth, depth, before, instant, decay)
    parts = jnp.exp(-decay) * state.parts + step
    return Relaxing(depth, parts), fractions[0] * instant + fractions[1:] @ parts


def hereditary_force(
    elastic: AbstractElastic,
    relaxation: AbstractRelaxation,
    time: Array,
    depth: Array,
    sagitta: Array | None = None,
) -> Array:
    """Return the force (N,) in N of one test at the points ``time`` (s) and ``depth`` (mm).

    Arrays of NumPy may have more axes, of tests and sets of constants, after that of time.
    """
    if xp.on_numpy(time, depth, *jax.tree.leaves((elastic, relaxation))):
        return _on_numpy(elastic, relaxation, time, depth, sagitta)
    return _compiled(elastic, relaxation, time, depth, sagitta)


def _on_numpy(
    elastic: AbstractElastic,
    relaxation: AbstractRelaxation,
    time: Array,
    depth: Array,
    sagitta: Array | None,
) -> Array:
    """Return the force (N, ...) of NumPy arrays."""
    fractions, rates = relaxation.spectrum()
    alike = _alike(elastic, rates, [x for x in (time, depth, sagitta) if x is not None])
    if alike is not None:
        first, which = alike
        elastic = jax.tree.map(lambda x: x[..., first], elastic)
        rates = rates[:, first]
    else:
        which = None
    instant, lasting = np.asarray(elastic.force(depth)), xp.steps(time)
    start = np.concatenate([np.zeros_like(depth[:1]), depth[:-1]])
    at_zero = np.asarray(elastic.force(np.zeros_like(depth[:1])))
    before = xp.concatenate([at_zero, instant[:-1]])
    path = (start, depth, before, instant)
    rise, given = None, None
    if type(elastic).relaxed_step is AbstractElastic.relaxed_step:
        rise = elastic.rise(*path)
    else:
        given = xp.stack([elastic.relaxed_step(*path, rate * lasting) for rate in rates])
    if sagitta is not None and np.any(sagitta):
        stiffness = np.asarray(elastic.stiffness(depth))
        bulge = 2.0 * sagitta * (stiffness + np.concatenate([stiffness[:1], stiffness[:-1]]))
        rise = (rise or Rise(())).plus(bulge, -2.0 * bulge)
    lasts = fractions[0] * (instant if which is None else instant[..., which])
    return add_modes(lasts, lasting, rates, fractions[1:], rise, given, which)


def _alike(
    elastic: AbstractElastic, rates: Array, path: list[Array]
) -> tuple[NDArray[np.intp], NDArray[np.intp]] | None:
    """Return which sets of constants differ in how modes are driven, and the one (K,) of each set.

    A Jacobian has a set for each constant. Those that change fractions of the spectrum or effects
    above the material share the states of the first set's modes. None if no set does: where the
    ``path`` of time and depth (N, T, K) differs by set, they are not compared.
    """
    if any(np.ndim(x) != 3 or x.shape[2] > 1 for x in path) or np.ndim(rates) != 2:
        return None
    count = rates.shape[1]
    leaves = jax.tree.leaves(elastic)
    if any(np.ndim(x) == 0 or x.shape[-1] != count for x in leaves):
        return None
    rows = np.concatenate([np.reshape(x, (-1, count)) for x in (*leaves, rates)])
    other = np.any(rows != rows[:, :1], axis=0)
    if np.count_nonzero(other) == count - 1:
        return None
    first = np.append(0, np.flatnonzero(other))
    return first, np.cumsum(other) * other


@jax.jit  # an effect may call it several times: it is traced once
def _compiled(
    elastic: AbstractElastic,
    relaxation: AbstractRelaxation,
    time: Array,
    depth: Array,
    sagitta: Array | None,
) -> Array:
    """Return the force (N,) of JAX arrays."""
    fractions, rates = relaxation.spectrum()
    shares = fractions[1:, None]
    instant, local, left, starts = _recursion(elastic, rates, shares, (time, depth, sagitta))
    force = fractions[0] * instant + local + jnp.sum(left * (shares * starts), axis=1)
    return force.T.reshape(-1)[: time.shape[0]]


def _recursion(
    elastic: AbstractElastic,
    rates: Array,
    shares: Array,
    path: tuple[Array, Array, Array | None],
) -> tuple[Array, Array, Array, Array]:
    """Return F_e and the sum of c_i q_i as parts of chunks, with time down the columns."""
    time, depth, sagitta = path
    times, start_time = _chunks(time, time[0])
    depths, start_depth = _chunks(depth, jnp.zeros((), depth.dtype))
    instant = elastic.force(depths)
    sagittas = None
    if sagitta is not None:
        sagittas, _ = _chunks(sagitta * _mean_stiffness(elastic, depth), sagitta[0])
    rates = rates[:, None]

    def advance(state: tuple[Array, ...], point: tuple[Any, ...]) -> tuple:
        part, time_before, depth_before, instant_before = state
        time_now, depth_now, instant_now, sagitta_now = point
        decay = rates * (time_now - time_before)
        step = elastic.relaxed_step(depth_before, depth_now, instant_before, instant_now, decay)
        survival = jnp.exp(-decay)
        part = survival * part + step
        if sagitta_now is not None:
            part = part - sagitta_now * _sagitta_factor(decay, survival)
        return (part, time_now, depth_now, instant_now), jnp.sum(shares * part, axis=0)

    shape = (rates.shape[0], times.shape[1])
    first = (jnp.zeros(shape), start_time, start_depth, elastic.force(start_depth))
    local: Array
    (last, *_), local = jax.lax.scan(advance, first, (times, depths, instant, sagittas))
    left = jnp.exp(-rates * (times - start_time)[:, None])
    return instant, local, left, _chunk_starts(left[-1], last)


def _mean_stiffness(elastic: AbstractElastic, depth: Array) -> Array:
    """Return K (N/mm), shape (N,), averaged over the step that ends at each point."""
    stiffness = elastic.stiffness(depth)
    return 0.5 * (stiffness + jnp.concatenate([stiffness[:1], stiffness[:-1]]))


def _sagitta_factor(decay: Array, survival: Array) -> Array:
    r"""Return 4 a \int_0^1 x (1 - x) e^{-a (1 - x)} dx at a = decay; survival is e^{-a}."""
    near = decay < _NEAR
    far = jnp.where(near, 1.0, decay)
    close = jnp.where(near, decay, 0.0)
    series = close * (1.0 / 6.0 + close * (-1.0 / 12.0 + close * (1.0 / 40.0 - close / 180.0)))
    return 4.0 * jnp.where(near, series, (decay - 2.0 + (decay + 2.0) * survival) / far**2)


def _chunk_count(points: int) -> int:
    """Return how many chunks a motion is cut into: about as many as each has steps."""
    if points <= _VECTOR:
        return points
    return _VECTOR * math.ceil(math.sqrt(points) / _VECTOR)


def _chunks(values: Array, before: Array) -> tuple[Array, Array]:
    """Return values (length, chunks), with time down the columns, and those before each column."""
    count = _chunk_count(values.shape[0])
    length = -(-values.shape[0] // count)
    missing = count * length - values.shape[0]
    columns = jnp.pad(values, (0, missing), mode="edge").reshape(count, length)
    return columns.T, jnp.concatenate([before[None], columns[:-1, -1]])


def _chunk_starts(survival: Array, part: Array) -> Array:
    """Return the state at each chunk's beginning, from every chunk's own decay and contribution."""

    def advance(state: Array, chunk: tuple[Array, Array]) -> tuple[Array, Array]:
        return chunk[0] * state + chunk[1], state

    _, before = jax.lax.scan(advance, jnp.zeros(part.shape[0]), (survival.T, part.T))
    return before.T
