"""Forces of many sets of constants at once: the one function of the model that is compiled.

Slopes are differences of two forces. Kinks of contact and clearance have no derivative that would
serve better, and what is compiled and traced is half as much.
"""

from __future__ import annotations

import jax
import numpy as np
from jaxtyping import Array
from numpy.typing import NDArray

from qlvbayes.inference.linearised import compiled
from qlvbayes.inference.subset import Ensemble
from qlvbayes.posterior import Posterior

TOGETHER = 16
"""Sets of constants come in multiples of this, so that few sizes are compiled."""


@compiled
def _forces(posterior: Posterior, constants: Array) -> Array:
    return jax.vmap(lambda x: posterior.predict_with(posterior.with_constants(x)[0]))(constants)


def forces(ensemble: Ensemble, constants: NDArray[np.float64]) -> NDArray[np.float64]:
    """(K, T, B) block means of the force (N) of constants (K, P), by the cheapest part."""
    first = constants[0]
    moved = np.any(constants != first, axis=0).astype(float)
    part = ensemble.part(first, moved)
    own = constants[:, part.constants]
    found = []
    for start in range(0, len(own), TOGETHER):
        some = own[start : start + TOGETHER]
        full = np.concatenate([some, np.repeat(some[:1], TOGETHER - len(some), axis=0)])
        found.append(np.asarray(_forces(part.posterior, full))[: len(some)])
    return np.concatenate(found)
