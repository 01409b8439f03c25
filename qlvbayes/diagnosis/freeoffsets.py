r"""A rival that no list holds: a force offset of its own in every test.

.. math:: F = F_{plain} + F_{peak} a_{test}

with normal priors of the a. It stands for what the list leaves out of the force over the clock (a
cell zeroed anew before each test, something in the rig that gives way in the middle of the study).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from qlvbayes.diagnosis.freeform import AbstractFreeForm
from qlvbayes.inference.gaussnewton import predict_along

_SD = 0.05  # of each offset, over the peak force


@dataclass(frozen=True, eq=False)
class FreeOffsets(AbstractFreeForm):
    """The plain model and an offset a test; see the module."""

    @property
    def sds(self) -> np.ndarray:
        """(T,) of the offsets' priors."""
        return np.full(len(self.ensemble.posterior.record.blocks.force), _SD)

    def combine(
        self, constants: np.ndarray, directions: np.ndarray, coefficients: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """The plain model's force and the offsets."""
        plain, slopes = predict_along(self.ensemble, constants, directions)
        tests, blocks = plain.shape
        own = self.experiment.scales.force * np.repeat(np.eye(tests)[..., None], blocks, axis=2)
        return plain + np.tensordot(coefficients, own, 1), np.concatenate([slopes, own])
