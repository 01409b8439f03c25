"""Evaluate a model step by step: the force of the next displacement, and the inverse.

A material has one state variable for each relaxing mode, so that a step costs O(modes) however long
the motion has been. Displacement is linear in time over a step, for which the step is exact
(Taylor, Pister & Goudreau 1970, doi:10.1002/nme.1620020106, with the exact integral). The
displacement that gives a force is the root of a rising function, found by Newton's steps inside a
bracket.
"""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike

from qlvbayes.effects.effect import AbstractEffect
from qlvbayes.io.checks import InputError
from qlvbayes.laws.layered import Contact, Law
from qlvbayes.laws.layered import State as LawState
from qlvbayes.laws.motion import Line
from qlvbayes.model.model import Model
from qlvbayes.pytree import Pytree

_CLOSE = 1e-7  # of the travel: the error after one more of Newton's steps is about its square
_ROUNDING = 1e-15  # of the displacement: a smaller step is lost in rounding
_MOST = 100  # steps; 60 halve a bracket down to rounding
_WIDE = 1.0  # mm, or the file's unit: a first guess where the stiffness is zero, doubled as needed
_FAR = 1e9  # mm, or the file's unit: away from any specimen

# root, low, high, move, count, converged
_Bracket = tuple[Array, Array, Array, Array, Array, Array]


class State(Pytree):
    """Displacement of the platen (mm), and the state of the specimen and the rig."""

    displacement: Array
    law: LawState


def begin(model: Model, displacement: ArrayLike = 0.0) -> State:
    """Return the state of a specimen at rest at zero until its platen moved to ``displacement``."""
    start = jnp.asarray(displacement, dtype=float)
    return State(start, model.law.begin(start))


def step(model: Model, state: State, displacement: ArrayLike, dt: ArrayLike) -> tuple[State, Array]:
    r"""Return state and force (N) after a straight line to ``displacement`` (mm) in ``dt`` (s)."""
    return _along(model.law, state, jnp.asarray(displacement) - state.displacement, dt)


def step_to_force(
    model: Model, state: State, force: ArrayLike, dt: ArrayLike
) -> tuple[State, Array]:
    """Return state and displacement (mm) after a line that ends at ``force`` (N) in ``dt`` (s)."""
    law = model.law
    goal = jnp.maximum(jnp.asarray(force, dtype=float), _untouched(law, state, dt))
    followed = _followed(law)

    def excess(law: Law, state: State, travel: Array, goal: Array, dt: ArrayLike) -> Array:
        return _along(law, state, travel, dt)[1] - goal

    frozen = jax.lax.stop_gradient((followed, state, goal, jnp.asarray(dt, dtype=float)))
    root = _root(
        lambda travel: excess(frozen[0], frozen[1], travel, *frozen[2:]), frozen[1].displacement
    )
    # one more of Newton's steps, at fixed slope: it carries the root's derivatives
    left, slope = _with_slope(lambda travel: excess(followed, state, travel, goal, dt), root)
    slope = jax.lax.stop_gradient(slope)
    travel = root - jnp.where(slope > 0.0, left / jnp.where(slope > 0.0, slope, 1.0), 0.0)
    state, _ = _along(law, state, travel, dt)
    return state, state.displacement


def begin_at_force(model: Model, force: ArrayLike) -> tuple[State, Array]:
    """Return state and displacement (mm) just after ``force`` (N) was put on a specimen at rest."""
    return step_to_force(model, begin(model), force, 0.0)


def without_steps(model: Model) -> dict[str, str]:
    """Return the model's effects that cannot be evaluated step by step, each with the reason."""
    return {e.name: e.not_stepped for e in model.effects if not steps(type(e))}


def without_inverse(model: Model) -> dict[str, str]:
    """Return the effects for which no displacement is found from a force, each with the reason."""
    one_way = {e.name: e.not_inverted for e in model.effects if not e.inverts}
    return one_way | without_steps(model)


def steps(kind: type[AbstractEffect]) -> bool:
    """Return whether the effect can be evaluated step by step."""
    return kind.step is not AbstractEffect.step


def _along(law: Law, state: State, travel: Array, dt: ArrayLike) -> tuple[State, Array]:
    duration = jnp.asarray(dt, dtype=float)
    moving = duration > 0.0
    velocity = jnp.where(moving, travel / jnp.where(moving, duration, 1.0), 0.0)
    end = state.displacement + travel
    inner, force = law.step(state.law, Line(duration, end, velocity))
    return State(end, inner), force


def _untouched(law: Law, state: State, dt: ArrayLike) -> Array:
    """Return the force (N) with the platen off a loose specimen, the lowest; -inf if bonded."""
    if not any(isinstance(layer, Contact) for layer in law.layers):
        return jnp.asarray(-jnp.inf)
    away = Line(jnp.asarray(dt, dtype=float), jnp.asarray(-_FAR), jnp.asarray(0.0))
    return law.step(state.law, away)[1]


def _followed(law: Law) -> Law:
    """Return the law whose force rises with displacement beyond the loss of contact too."""
    layers = tuple(Contact(True) if isinstance(x, Contact) else x for x in law.layers)
    return Law(law.elastic, law.relaxation, layers)


def _with_slope(function: Callable[[Array], Array], point: Array) -> tuple[Array, Array]:
    value, slope = jax.jvp(function, (point,), (jnp.ones_like(point),))
    return value, slope


def _root(excess: Callable[[Array], Array], start: Array) -> Array:
    """Return the travel from ``start`` at which a rising function is zero, or not a number."""

    def close(travel: Array, move: Array) -> Array:
        return jnp.abs(move) <= _CLOSE * jnp.abs(travel) + _ROUNDING * jnp.abs(start + travel)

    def better(carry: _Bracket) -> _Bracket:
        travel, low, high, last, count, _ = carry
        value, slope = _with_slope(excess, travel)
        value = jnp.where(jnp.isnan(value), jnp.inf, value)  # too deep for a number
        low, high = jnp.where(value <= 0.0, travel, low), jnp.where(value >= 0.0, travel, high)
        move = jnp.where(slope > 0.0, -value / jnp.where(slope > 0.0, slope, 1.0), jnp.nan)
        good = (jnp.abs(move) <= 0.5 * last) & (travel + move >= low) & (travel + move <= high)
        wide = jnp.sign(-value) * jnp.where(jnp.isfinite(last), 2.0 * last, _WIDE)
        middle = 0.5 * (low + high) - travel
        other = jnp.where(jnp.isfinite(middle), middle, wide)
        move = jnp.where(value == 0.0, 0.0, jnp.where(good, move, other))
        return travel + move, low, high, jnp.abs(move), count + 1, close(travel, move)

    def going_on(carry: _Bracket) -> Array:
        return ~carry[-1] & (carry[-2] < _MOST)

    zero, infinite = jnp.zeros_like(start), jnp.full_like(start, jnp.inf)
    first = (zero, -infinite, infinite, infinite, jnp.zeros((), int), jnp.zeros((), bool))
    travel, *_, converged = jax.lax.while_loop(going_on, better, first)
    return jnp.where(converged, travel, jnp.nan)


def displacement_from_force(model: Model, time: ArrayLike, force: ArrayLike) -> Array:
    r"""Return the displacement at which a specimen has a given force, point after point.

    This solves :math:`F[\delta](t_k) = F_k`, with the displacement linear between points, of second
    order in the spacing. The specimen is at rest until the first point; a first force other than
    zero is applied at once. A loose specimen carries no force below zero: there the platen rests on
    its surface. From the point at which no displacement has the force (a law that softens) the
    answer is not a number. The computation is O(N), and differentiable in model and force, also
    under jit and vmap (Findley, Lai & Onaran 1976, ch. 5, for the linear case). An InputError where
    an effect has no step, the arrays differ in shape, or time runs back.

    Parameters
    ----------
    model, time, force
        Model whose every constant is a number; (N,) in s, rising; (N,) in N. Returns (N,) in mm.
    """
    check_inverse(model)
    time, force = jnp.asarray(time, dtype=float), jnp.asarray(force, dtype=float)
    if time.ndim != 1 or time.shape != force.shape:
        raise InputError(
            f"time {time.shape} and force {force.shape}", remedy="give both as rows of one length"
        )
    if not isinstance(time, jax.core.Tracer) and np.any(np.diff(time) < 0.0):
        raise InputError("time runs back", remedy="order the points by time")
    return _displacements(model, time, force)


def check_inverse(model: Model) -> None:
    """Raise InputError that names the effects for which no displacement is found from a force."""
    check_steps(model)
    if why := without_inverse(model):
        raise InputError(
            f"no displacement is found from a force: {_in_words(why)}",
            remedy="leave the effect out, or prescribe the displacement",
        )


def check_steps(model: Model) -> None:
    """Raise InputError that names the effects that cannot be evaluated step by step."""
    if why := without_steps(model):
        raise InputError(
            f"no step by step form, hence no displacement from a force: {_in_words(why)}",
            remedy="leave the effect out, or prescribe the displacement",
        )


def _in_words(why: dict[str, str]) -> str:
    return "; ".join(f"{name}: {reason}" for name, reason in why.items())


@jax.jit
def _displacements(model: Model, time: Array, force: Array) -> Array:
    def advance(state, point):  # type: ignore[no-untyped-def]
        return step_to_force(model, state, *point)

    state, first = begin_at_force(model, force[0])
    _, others = jax.lax.scan(advance, state, (force[1:], jnp.diff(time)))
    return jnp.concatenate([first[None], others])
