"""The rules of a relaxation whose constants are numbers."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from qlvbayes.laws.lawerror import LawError
from qlvbayes.laws.relaxation.law import AbstractRelaxation

_EXACT = 1e-12
_BEYOND = 10.0  # times the tests' shortest and longest times that are looked at


def check_relaxation(law: AbstractRelaxation, shortest: float, longest: float) -> None:
    """Raise LawError unless the spectrum is one, for times (s) around those of the tests."""
    fractions, rates = law.spectrum()
    if fractions.shape != (rates.shape[0] + 1,):
        raise LawError(f"{law}: a spectrum has one fraction more than rates")
    if not np.all(np.isfinite(fractions)) or not np.all(np.isfinite(rates)):
        raise LawError(f"{law}: the spectrum is not finite")
    if np.min(fractions) < 0.0:
        raise LawError(f"{law}: a fraction of the spectrum is negative")
    if abs(float(jnp.sum(fractions)) - 1.0) > _EXACT:
        raise LawError(f"{law}: the fractions sum to {float(jnp.sum(fractions)):.12g}, not 1")
    if np.min(rates) <= 0.0:
        raise LawError(f"{law}: a rate of the spectrum is not above 0")
    time = jnp.asarray(np.geomspace(shortest / _BEYOND, longest * _BEYOND, 60))
    curve = law.curve(jnp.concatenate([jnp.zeros(1), time]))
    if abs(float(curve[0]) - 1.0) > _EXACT or np.max(np.diff(curve)) > _EXACT:
        raise LawError(f"{law}: g must begin at 1 and fall")
    compiled = _compiled(law, time)
    if not np.allclose(compiled, curve[1:], rtol=0.0, atol=1e-10):
        raise LawError(f"{law}: compiled and plain evaluation differ")
    _check_slopes(law, time)
    if not all(float(x) > 0.0 for x in law.times().values()):
        raise LawError(f"{law}: its times must be above 0")


_compiled = eqx.filter_jit(lambda law, time: law.curve(time))  # once for all draws of a law


def _check_slopes(law: AbstractRelaxation, time: Array) -> None:
    slopes = jax.tree.leaves(jax.jacfwd(lambda law: law.curve(time))(law))
    if not all(np.all(np.isfinite(slope)) for slope in slopes):
        raise LawError(f"{law}: a slope of g along one of its constants is not finite")
