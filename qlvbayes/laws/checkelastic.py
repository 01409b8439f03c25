"""The rules of an elastic law whose constants are numbers."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from numpy.polynomial.legendre import leggauss

from qlvbayes.laws.elastic.law import AbstractElastic
from qlvbayes.laws.lawerror import LawError

_EXACT = 1e-9  # of the largest force or stiffness
_STEP = 2e-3  # of the depth: one step of a grid as the model's is
_STEP_ERROR = 1e-5  # of the integral, for laws whose step has no closed form;
# at first contact, where a power is not smooth, of the largest force: a tenth of what the straight
_TOUCH_ERROR = 1e-5  # lines of the model's grid may add
_DECAYS = (0.0, 1e-3, 0.3, 3.0)
_PANELS = 64  # of the quadrature of a step, each of 8 nodes
_NODES, _WEIGHTS = leggauss(8)


def check_elastic(law: AbstractElastic, depth: float) -> None:
    """Raise LawError unless force, stiffness and step belong together up to ``depth`` (mm)."""
    depths = jnp.linspace(0.0, depth, 41)
    force, stiffness = law.force(depths), law.stiffness(depths)
    if force.shape != depths.shape or stiffness.shape != depths.shape:
        raise LawError(f"{law}: force and stiffness must have the shape of the depth")
    if not np.all(np.isfinite(force)) or not np.all(np.isfinite(stiffness)):
        raise LawError(f"{law}: force or stiffness is not finite")
    if abs(float(force[0])) > _EXACT * float(jnp.max(jnp.abs(force))):
        raise LawError(f"{law}: the force at zero depth is {float(force[0]):.3g}, not zero")
    slope = jax.vmap(jax.grad(law.force))(depths[1:])
    error = float(jnp.max(jnp.abs(slope - stiffness[1:])) / jnp.max(jnp.abs(stiffness)))
    if not error <= _EXACT:
        raise LawError(f"{law}: stiffness is off the slope of the force by {error:.1e}")
    _check_steps(law, depth)
    _check_slopes(law, depths)


def _check_steps(law: AbstractElastic, depth: float) -> None:
    for start in (0.0, 0.15 * depth, 0.6 * depth):
        for stop in (start + _STEP * depth, max(start - _STEP * depth, 0.0)):
            for decay in _DECAYS:
                found, exact = _step(law, start, stop, decay), _integral(law, start, stop, decay)
                most = abs(float(law.force(jnp.asarray(depth))))
                least = _TOUCH_ERROR * most if start == 0.0 else 0.0
                allowed = max(_STEP_ERROR * max(abs(exact), _STEP * most), least)
                if not abs(found - exact) <= allowed:
                    raise LawError(
                        f"{law}: the step from {start:.3g} to {stop:.3g} at a decay of {decay:g} "
                        f"is {found:.6g}, its integral {exact:.6g}"
                    )


def _step(law: AbstractElastic, start: float, stop: float, decay: float) -> float:
    """Compiled and plain, which must agree."""
    given = [jnp.asarray(x) for x in (start, stop, decay)]
    plain, compiled = float(_run(law, *given)), float(_compiled(law, *given))
    if not np.isclose(plain, compiled, rtol=1e-10, atol=1e-14):
        raise LawError(f"{law}: compiled and plain steps differ: {compiled:.12g}, {plain:.12g}")
    return plain


def _run(law: AbstractElastic, start: Array, stop: Array, decay: Array) -> Array:
    return law.relaxed_step(start, stop, law.force(start), law.force(stop), decay)


_compiled = eqx.filter_jit(_run)  # once for all draws of a law


def _integral(law: AbstractElastic, start: float, stop: float, decay: float) -> float:
    """Of e^{-decay (1 - s)} K(depth(s)) over the step, in panels dense at its start."""
    edges = np.linspace(0.0, 1.0, _PANELS + 1) ** 3
    half = 0.5 * np.diff(edges)[:, None]
    s = edges[:-1, None] + half * (1.0 + _NODES)
    stiffness = np.asarray(law.stiffness(jnp.asarray(start + (stop - start) * s)))
    return float(np.sum(half * _WEIGHTS * np.exp(-decay * (1.0 - s)) * stiffness * (stop - start)))


def _check_slopes(law: AbstractElastic, depths: Array) -> None:
    def total(law: AbstractElastic) -> Array:
        force = law.force(depths)
        step = law.relaxed_step(depths[:-1], depths[1:], force[:-1], force[1:], jnp.asarray(0.1))
        rest = law.relaxed_step(depths, depths, force, force, jnp.asarray(0.1))
        return jnp.sum(step) + jnp.sum(rest) + jnp.sum(force)

    slopes = jax.tree.leaves(jax.grad(total)(law))
    if not all(np.all(np.isfinite(slope)) for slope in slopes):
        raise LawError(f"{law}: a slope along one of its constants is not finite")
