"""The model of a specimen: an elastic law, a relaxation, and whether it can pull."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from qlvbayes.elastic import AbstractElastic
from qlvbayes.hereditary import hereditary_force
from qlvbayes.motion import Motion
from qlvbayes.relaxation import Prony


class Model(eqx.Module):
    """Quasi-linear viscoelastic specimen (Fung), the paper's Eq. 6.

    elastic: an elastic law; relaxation: a Prony series; bonded: whether the specimen is fixed to
    the platen. One that is not cannot pull: it is not touched at negative displacement and its
    force is never negative. A field of either part is a number (fixed) or a prior (free).
    """

    elastic: AbstractElastic
    relaxation: Prony
    bonded: bool = eqx.field(static=True, default=False)

    def force(self, motion: Motion) -> Array:
        """Force (N,) in N at the motion's N grid points; every constant must be a number."""
        if self.bonded:
            return self._material_force(motion.time, motion.displacement)
        depth = jnp.maximum(motion.displacement, 0.0)
        return jnp.maximum(self._material_force(motion.time, depth), 0.0)

    def _material_force(self, time: Array, depth: Array) -> Array:
        return hereditary_force(self.elastic, self.relaxation, time, depth)
