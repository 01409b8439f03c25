r"""A rival that no list holds: a spring of free form beside the pad.

.. math:: F = F_{plain} + F_{peak} \sum_{k=1}^8 a_k (P_k(x) - P_k(-1))

with Legendre polynomials P_k of the depth x and normal priors of the a_k. It stands for what the
list leaves out of the force over depth (a second contact, a stiffer core). Where it explains the
tests better than the effects that were found, these are not named: they only imitate.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from qlvbayes.diagnosis.freeform import AbstractCurvedForm, polynomials
from qlvbayes.inference.gaussnewton import predict_along

_ORDERS = 8
_SD = 0.03  # of each coefficient


@dataclass(frozen=True, eq=False)
class FreeSpring(AbstractCurvedForm):
    """The plain model and the spring; see the module."""

    @property
    def sds(self) -> np.ndarray:
        """(8,) of the coefficients' priors."""
        return np.full(_ORDERS, _SD)

    def curves(self, depth: np.ndarray, clock: np.ndarray) -> np.ndarray:
        """(8, ...) polynomials of depth that are 0 at no depth; the clock has no part in it."""
        start = polynomials(np.zeros(1), _ORDERS).reshape(-1, *[1] * np.ndim(depth))
        return polynomials(depth, _ORDERS) - start

    def combine(
        self, constants: np.ndarray, directions: np.ndarray, coefficients: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """The plain model's force and the spring's."""
        plain, slopes = predict_along(self.ensemble, constants, directions)
        spring = self.experiment.scales.force * self.at_blocks
        return plain + np.tensordot(coefficients, spring, 1), np.concatenate([slopes, spring])
