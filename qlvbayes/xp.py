"""Array functions that run on NumPy and on JAX alike, under the customary name ``xp``.

A law or an effect is written once with these functions. Given JAX arrays they are those of
``jax.numpy``, which can be differentiated and compiled. Given NumPy arrays or numbers they are
those of ``numpy``, which need no compilation.

Arrays of JAX have time as their only axis, (N,). Those of NumPy have time as their first axis and
may have more: (N, T, K) for T tests and K sets of constants, which then have shape (K,). All
functions that work along time therefore work along the first axis.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import jax
import jax.numpy as jnp
import jax.scipy.special
import numpy as np
import scipy.special

Array: TypeAlias = Any
"""An array of NumPy or of JAX, or a number: a type checker knows no common type."""

_NUMPY = (np.ndarray, np.generic, float, int, complex, type(None))


def on_numpy(*values: Any) -> bool:
    """Return whether no value, nor any in a sequence of them, is an array of JAX."""
    for value in values:
        if isinstance(value, _NUMPY):
            continue
        if not isinstance(value, list | tuple) or not on_numpy(*value):
            return False
    return True


def _either(by_numpy: Callable[..., Any], by_jax: Callable[..., Any]) -> Callable[..., Any]:
    """Return the function that the first arguments' kind of array asks for."""

    def function(*values: Any, **options: Any) -> Any:
        if on_numpy(*values) and on_numpy(*options.values()):
            return by_numpy(*values, **options)
        return by_jax(*values, **options)

    function.__name__ = function.__qualname__ = by_jax.__name__
    function.__doc__ = f"Return {by_jax.__name__} of arrays of NumPy or of JAX."
    return function


def _quiet(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function of NumPy that says nothing of infinite values, as JAX says nothing."""

    def quiet(*values: Any, **options: Any) -> Any:
        with np.errstate(all="ignore"):
            return function(*values, **options)

    return quiet


where = _either(np.where, jnp.where)
exp = _either(_quiet(np.exp), jnp.exp)
expm1 = _either(_quiet(np.expm1), jnp.expm1)
log = _either(_quiet(np.log), jnp.log)
log1p = _either(_quiet(np.log1p), jnp.log1p)
sin = _either(np.sin, jnp.sin)
abs = _either(np.abs, jnp.abs)
sign = _either(np.sign, jnp.sign)
floor = _either(np.floor, jnp.floor)
imag = _either(np.imag, jnp.imag)
maximum = _either(np.maximum, jnp.maximum)
minimum = _either(np.minimum, jnp.minimum)
clip = _either(np.clip, jnp.clip)
zeros_like = _either(np.zeros_like, jnp.zeros_like)
ones_like = _either(np.ones_like, jnp.ones_like)
full_like = _either(np.full_like, jnp.full_like)
sigmoid = _either(scipy.special.expit, jax.nn.sigmoid)
log_sigmoid = _either(scipy.special.log_expit, jax.nn.log_sigmoid)
gammaln = _either(scipy.special.gammaln, jax.scipy.special.gammaln)


def softplus(x: Array) -> Array:
    """Return log(1 + e^x)."""
    return np.logaddexp(x, 0.0) if on_numpy(x) else jax.nn.softplus(x)


def asarray(x: Any) -> Array:
    """Return numbers as a float array; an array of JAX stays one."""
    return np.asarray(x, dtype=float) if on_numpy(x) else jnp.asarray(x, dtype=float)


def fixed(x: Array) -> Array:
    """Return values that derivatives take as constant."""
    return x if on_numpy(x) else jax.lax.stop_gradient(x)


def concatenate(parts: Sequence[Array]) -> Array:
    """Return arrays joined along their first axis; their other axes are broadcast."""
    if not on_numpy(*parts):
        return jnp.concatenate(parts)
    shapes = [np.shape(part)[1:] for part in parts]
    if any(shape != shapes[0] for shape in shapes):
        common = np.broadcast_shapes(*shapes)
        parts = [np.broadcast_to(spread(part, len(common)), (len(part), *common)) for part in parts]
    return np.concatenate(parts)


def spread(x: Array, rest: int) -> Array:
    """Return an array of NumPy with ``rest`` axes after the first, new ones of length 1."""
    shape = np.shape(x)
    return np.reshape(x, shape[:1] + (1,) * (rest + 1 - len(shape)) + shape[1:])


def stack(values: Sequence[Array]) -> Array:
    """Return values stacked along a new first axis; their shapes are broadcast."""
    if on_numpy(*values):
        alike = len({np.shape(value) for value in values}) == 1
        return np.array(values if alike else np.broadcast_arrays(*values))
    return jnp.stack([jnp.asarray(value) for value in values])


def sum(x: Array) -> Array:
    """Return the sum along the first axis."""
    return np.sum(x, axis=0) if on_numpy(x) else jnp.sum(x, axis=0)


def cumsum(x: Array) -> Array:
    """Return the running sum along the first axis."""
    return np.cumsum(x, axis=0) if on_numpy(x) else jnp.cumsum(x, axis=0)


def diff(x: Array) -> Array:
    """Return the differences of neighbours along the first axis, one fewer."""
    return x[1:] - x[:-1]


def steps(x: Array) -> Array:
    """Return the differences from each point's predecessor along the first axis, 0 at first."""
    return concatenate([zeros_like(x[:1]), diff(x)])


def max(x: Array) -> Array:
    """Return the largest value along the first axis."""
    return np.max(x, axis=0) if on_numpy(x) else jnp.max(x, axis=0)


def cummax(x: Array) -> Array:
    """Return the largest value so far along the first axis."""
    return np.maximum.accumulate(x, axis=0) if on_numpy(x) else jax.lax.cummax(x)


def first_true(mask: Array) -> Array:
    """Return the index of the first True along the first axis, which is kept with length 1."""
    return np.argmax(mask, axis=0)[None] if on_numpy(mask) else jnp.argmax(mask)[None]


def argsort(x: Array) -> Array:
    """Return the indices that sort along the first axis; equal values keep their order."""
    return np.argsort(x, axis=0, kind="stable") if on_numpy(x) else jnp.argsort(x)


def take(x: Array, index: Array) -> Array:
    """Return x at indices along its first axis, set by set where the other axes have length."""
    if not on_numpy(x, index):
        return jnp.asarray(x)[index]
    rest = np.ndim(x) - 1
    sizes = enumerate(x.shape[1:], start=1)
    shared = [np.arange(n).reshape((-1,) + (1,) * (rest - k)) for k, n in sizes]
    return x[(index, *shared)]


def searchsorted(x: Array, values: Array) -> Array:
    """Return where values belong in a rising x, along the first axis."""
    if not on_numpy(x, values):
        return jnp.searchsorted(x, values)
    shape = np.broadcast_shapes(x.shape[1:], values.shape[1:])
    rows = np.broadcast_to(x, (len(x), *shape)).reshape(len(x), -1)
    wanted = np.broadcast_to(values, (len(values), *shape)).reshape(len(values), -1)
    pairs = zip(rows.T, wanted.T, strict=True)
    found = np.stack([np.searchsorted(row, own) for row, own in pairs], axis=1)
    return found.reshape(len(values), *shape)


def accumulate(combine: Callable[[Any, Any], Any], parts: tuple[Array, ...]) -> tuple[Array, ...]:
    """Return what an associative function makes of all parts so far, along the first axis."""
    if not on_numpy(*parts):
        result: tuple[Array, ...] = jax.lax.associative_scan(combine, parts)
        return result
    parts, span = tuple(np.broadcast_arrays(*parts)), 1
    while span < len(parts[0]):
        joined = combine(tuple(x[:-span] for x in parts), tuple(x[span:] for x in parts))
        parts = tuple(np.concatenate([x[:span], y]) for x, y in zip(parts, joined, strict=True))
        span *= 2
    return parts


def recur(advance: Callable[[Array, Any], Array], start: Array, points: tuple[Array, ...]) -> Array:
    """Return the states after each point, along the first axis, each made of the one before."""
    if on_numpy(start, *points):
        states, state = [], start
        for point in zip(*points, strict=True):
            state = advance(state, point)
            states.append(state)
        return np.stack(states)

    def carry(state: Array, point: Any) -> tuple[Array, Array]:
        state = advance(state, point)
        return state, state

    return jax.lax.scan(carry, start, points)[1]


def of_distinct(function: Callable[[Array], Any], constant: Array) -> Any:
    """Return the arrays that a costly function gives, computed once for equal constants (K,)."""
    if not on_numpy(constant) or np.ndim(constant) != 1:
        return function(constant)
    distinct, which = np.unique(constant, return_inverse=True)
    return tuple(x[..., which] for x in function(distinct))


def along_first(x: Any, like: Array) -> Array:
    """Return numbers (n,) in a shape that broadcasts with constants: (n, 1) with sets (K,)."""
    x = np.asarray(x) if on_numpy(x) else x
    return x.reshape(x.shape + (1,) * np.ndim(like))
