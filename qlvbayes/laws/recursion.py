"""Run the recursions of states over NumPy arrays, in C where they were compiled.

They are that of the hereditary integral and that of a fluid that drains; a curve in pieces is
evaluated there too. The compiled library (``recursion.c``) comes with the wheels and with any
installation that finds a C compiler. Without it NumPy does the same, about four, fifty and five
times as slowly.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from qlvbayes import xp
from qlvbayes.io.arrays import Array
from qlvbayes.laws.elastic.steps import Rise


def add_modes(
    force: Array,
    lasting: Array,
    rates: Array,
    shares: Array,
    rise: Rise | None,
    given: Array | None = None,
    which: NDArray[np.intp] | None = None,
) -> Array:
    """Return the force with its relaxing modes, sum_i c_i q_i, added.

    force (N, ...): the part that never relaxes (N); lasting (N, ...): the steps' durations (s);
    rates, shares (L, ...): of the modes; rise: how the elastic force rises along each step, over
    (N, ...); given (L, N, ...): what each step adds to each mode, where it is known. Axes after the
    first are broadcast. which (K,): where the last axis of force and shares has K sets that share
    states, the index of the state of each in the last axis of the others.
    """
    rise = rise or Rise(())
    parts = [lasting, rates, *rise.powers, *(rise.exponential or ())]
    shapes = [np.shape(x)[1:] for x in parts]
    if given is not None:
        shapes.append(np.shape(given)[2:])
    own = [np.shape(x)[1:] for x in (force, shares)]
    rest = np.broadcast_shapes(*shapes, *(own if which is None else ()))
    total = np.array(_whole(force, np.broadcast_shapes(*own, *(shapes if which is None else ()))))
    shares = _whole(shares, total.shape[1:])
    if given is not None:
        given = np.ascontiguousarray(np.broadcast_to(given, (*given.shape[:2], *rest)))
    powers = tuple(_whole(x, rest) for x in rise.powers)
    exponential: Any = rise.exponential and tuple(_whole(x, rest) for x in rise.exponential)
    run = _by_numpy if _library() is None else _by_library
    driven = _whole(lasting, rest), _whole(rates, rest)
    run(total, *driven, shares, Rise(powers, exponential), given, which)
    return total


def drained(
    points: Sequence[Array], constants: Sequence[Array], bounds: Sequence[float]
) -> Array | None:
    """Return the states (N + 1, ...) from 0 of a fluid that drains, or None where not compiled.

    points: duration, jump, source, balance and settling of each of N steps (N, ...); constants:
    tau, n and stroke (...); bounds: of the step, see `effects.fluids`, which says the equation.
    """
    library = _library()
    if library is None or not xp.on_numpy(points, constants):
        return None
    shapes = (*(np.shape(x)[1:] for x in points), *map(np.shape, constants))
    rest = np.broadcast_shapes(*shapes)
    every = [_whole(x, rest) for x in points]
    every += [np.ascontiguousarray(np.broadcast_to(x, rest), dtype=float) for x in constants]
    pressed = np.empty((len(every[0]) + 1, *rest))
    library.drain(
        *(ctypes.c_size_t(n) for n in (len(every[0]), pressed[0].size)),
        *(ctypes.c_void_p(x.ctypes.data) for x in every),
        *map(ctypes.c_double, bounds),
        ctypes.c_void_p(pressed.ctypes.data),
    )
    return pressed


def in_pieces(depth: Array, width: float, parabolas: Sequence[Array]) -> Array:
    """Return a curve of pieces of equal width, a parabola c0 + b (c1 + c2 b) each, at depths.

    b is the distance from where a piece begins; the first lies before zero, and the last has no
    end. parabolas: the coefficients (P,), or (P, K) of K curves, of each of P pieces. depth (...),
    or (..., 1 or K) for K curves.
    """
    count, *sets = np.shape(parabolas[0])
    library = _library()
    alike = sets and np.shape(depth)[-1:] in ((1,), (*sets,))
    if library is not None and alike and xp.on_numpy(depth, *parabolas):
        return _in_pieces_by_library(library, depth, width, parabolas)
    knot = xp.clip(xp.floor(depth / width), -1, count - 2)
    piece, beyond = knot.astype(int) + 1, depth - xp.maximum(knot, 0.0) * width
    constant, slope, bend = (xp.take(x, piece) for x in parabolas)
    return constant + beyond * (slope + bend * beyond)


def _in_pieces_by_library(
    library: ctypes.CDLL, depth: Array, width: float, parabolas: Sequence[Array]
) -> Array:
    count, sets = parabolas[0].shape
    depth = np.ascontiguousarray(depth, dtype=float)
    value = np.empty((*depth.shape[:-1], sets))
    library.in_pieces(
        *(ctypes.c_size_t(n) for n in (value.size // sets, sets, count)),
        ctypes.c_int(depth.shape[-1] == sets),
        ctypes.c_double(width),
        *(ctypes.c_void_p(x.ctypes.data) for x in (depth, *map(np.ascontiguousarray, parabolas))),
        ctypes.c_void_p(value.ctypes.data),
    )
    return value


def _whole(x: Array, rest: tuple[int, ...]) -> Array:
    """Return an array (N, *rest), contiguous, whose axes after the first were broadcast."""
    wide = np.broadcast_to(xp.spread(x, len(rest)), (len(x), *rest))
    return np.ascontiguousarray(wide, dtype=float)


def _by_numpy(
    total: Array,
    lasting: Array,
    rates: Array,
    shares: Array,
    rise: Rise,
    given: Array | None,
    which: NDArray[np.intp] | None,
) -> None:
    for k, (rate, share) in enumerate(zip(rates, shares, strict=True)):
        decay = rate * lasting
        step = rise.relaxed(decay) if given is None else given[k] + rise.relaxed(decay)
        left, state = np.exp(-decay), np.zeros_like(decay[0])
        states = np.empty_like(decay)
        for n in range(len(lasting)):
            state = left[n] * state + step[n]
            states[n] = state
        total += share * (states if which is None else states[..., which])


def _by_library(
    total: Array,
    lasting: Array,
    rates: Array,
    shares: Array,
    rise: Rise,
    given: Array | None,
    which: NDArray[np.intp] | None,
) -> None:
    def at(x: Array | None) -> ctypes.c_void_p:
        return ctypes.c_void_p(None if x is None else x.ctypes.data)

    none = (None,) * 3
    powers, exponential = (*rise.powers, *none)[:3], rise.exponential or none
    state = np.empty(lasting[0].size)
    source = None
    if which is not None:
        states = np.arange(state.size).reshape(lasting.shape[1:])
        source = np.ascontiguousarray(states[..., which], dtype=np.uintp)
    library = _library()
    assert library is not None
    library.add_modes(
        *(ctypes.c_size_t(n) for n in (len(total), state.size, total[0].size, len(rates))),
        *map(at, (lasting, rates, shares)),
        ctypes.c_int(len(rise.powers)),
        *map(at, (*powers, *exponential, given, source, state, total)),
    )


@cache
def _library() -> ctypes.CDLL | None:
    """Return the compiled library; None where there is none."""
    try:
        library = ctypes.CDLL(str(Path(__file__).with_suffix(".library")))
        for function in (library.add_modes, library.drain, library.in_pieces):
            function.restype = None
    except (OSError, AttributeError):  # there is none, or of another machine, or an older one
        return None
    return library
