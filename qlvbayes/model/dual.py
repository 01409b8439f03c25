"""Solve the dual problem: find the displacement of a whole test whose force is prescribed."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike

from qlvbayes.io.checks import InputError
from qlvbayes.model.model import Model
from qlvbayes.model.stepping import begin_at_force, step_to_force, without_inverse, without_steps


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
