"""Evaluate the model of a fit, and its posterior density, for many sets of constants at once."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import jax
import numpy as np
from numpy.typing import NDArray

from qlvbayes.fitting.marginal_likelihood import NoiseLikelihood
from qlvbayes.inference.density import LARGEST_FORCE
from qlvbayes.inference.forward.hypothesis import Hypothesis, Parameters
from qlvbayes.inference.forward.space import Space
from qlvbayes.io.arrays import Array
from qlvbayes.model.model import Model
from qlvbayes.model.noise import AbstractNoise
from qlvbayes.model.parameters import is_prior, names
from qlvbayes.motion.record import Record

_TOGETHER = 256  # sets of constants whose block means are held together


@dataclass(frozen=True, eq=False)
class Predictor:
    """One model over one record, in the engine of the diagnosis: a space of one hypothesis."""

    space: Space
    hypothesis: Hypothesis
    noise: AbstractNoise  # with priors where its constants are free

    @classmethod
    def from_model(cls, model: Model, noise: AbstractNoise, record: Record) -> Self:
        """Return the predictor of a model with numbers, or priors, in its fields."""
        elastic, relaxation = model.elastic, model.relaxation
        effects = {one.name: one for one in model.effects}
        # the likelihood sums over what is free of the noise
        summed = jax.tree.map(lambda x: np.nan if is_prior(x) else x, noise, is_leaf=is_prior)
        laws = {elastic.name: elastic}, {relaxation.name: relaxation}
        space = Space(record, *laws, effects, summed, model.bonded)
        return cls(space, Hypothesis(elastic.name, relaxation.name, frozenset(effects)), noise)

    def over(self, record: Record) -> Self:
        """Return the same model over another record."""
        return replace(self, space=replace(self.space, record=record))

    @property
    def record(self) -> Record:
        """Return the tests, along a leading axis."""
        return self.space.record

    @cached_property
    def parameters(self) -> Parameters:
        """Return the free parameters theta (D,)."""
        return self.space.parameters(self.hypothesis)

    @property
    def model(self) -> Model:
        """Return the model, with priors where its fields are free."""
        return self.parameters.model

    @property
    def names(self) -> list[str]:
        """Return the names of the P constants, those of the noise last."""
        return names(self)

    @property
    def size(self) -> int:
        """Return D, the number of free parameters."""
        return self.parameters.size

    def forces(self, constants: Array) -> Array:
        """Return block means (K, T, B) of the force (N) at constants (K, P)."""
        return self.space.forces(self.hypothesis, constants)

    def residuals(self, constants: Array) -> Array:
        """Return measured minus predicted block means (K, T, B) in N at constants (K, P)."""
        return np.asarray(self.record.blocks.force) - self.forces(constants)


@dataclass(frozen=True, eq=False)
class Posterior(Predictor):
    """Posterior density of theta: prior times likelihood of the record."""

    likelihood: NoiseLikelihood

    def log_density(self, thetas: Array) -> Array:
        """Return the log densities (K,) of prior times likelihood over thetas (K, D).

        They are minus infinity outside the parameters' bounds, and where the force is not finite.
        """
        logs = np.full(len(thetas), -np.inf)
        largest = LARGEST_FORCE * float(np.abs(self.record.blocks.force).max())
        for rows in _parts(np.arange(len(thetas))):
            kept, priors, left = self.space.residuals(self.hypothesis, thetas[rows], largest)
            logs[rows[kept]] = priors + self.likelihood.log_likelihood(left)
        return np.where(np.isnan(logs), -np.inf, logs)

    def drawn_constants(self, thetas: Array, rng: np.random.Generator) -> Array:
        """Return constants (K, P) at thetas (K, D), those that are summed over drawn.

        Thetas that are the same have the same constants.
        """
        visited, where = np.unique(thetas, axis=0, return_inverse=True)
        shares = rng.random(len(visited))
        constants = self.parameters.constants(visited)
        for rows in _parts(np.arange(len(visited))):
            constants[rows, self.of_noise] = self.likelihood.drawn(
                self.residuals(constants[rows]), shares[rows]
            )
        return np.asarray(constants[where.ravel()])

    @property
    def of_noise(self) -> slice:
        """Return the columns of the noise's constants among the P."""
        return slice(-len(self.noise.units), None)

    def judged(self, constants: Array, rng: np.random.Generator) -> tuple[Array, Array]:
        """Return pointwise log likelihoods, and block means with new noise, (K, n) each.

        constants (K, P): as `drawn_constants` gives them.
        """
        choices = self.likelihood.choices_of(constants[:, self.of_noise])
        real, logs, new = self.likelihood.real, [], []
        for rows in _parts(np.arange(len(constants))):
            forces = self.forces(constants[rows])
            residuals = np.asarray(self.record.blocks.force) - forces
            logs.append(self.likelihood.conditional(residuals, choices[rows]))
            errors = self.likelihood.replicates(residuals, choices[rows], rng)
            new.append(forces[:, real] + errors)
        return np.concatenate(logs), np.concatenate(new)

    @property
    def digest(self) -> str:
        """Return a digest of everything that the density depends on."""
        likelihood = self.likelihood
        leaves, shape = jax.tree.flatten((self.parameters.model, self.noise, self.record))
        leaves += [likelihood.axes, likelihood.precisions, likelihood.heights, likelihood.constants]
        digest = hashlib.sha256(str(shape).encode())
        for leaf in leaves:
            digest.update(np.ascontiguousarray(leaf).tobytes())
        return digest.hexdigest()


def _parts(rows: NDArray[np.intp]) -> list[NDArray[np.intp]]:
    """Return indices in parts that are computed together."""
    return [rows[k : k + _TOGETHER] for k in range(0, len(rows), _TOGETHER)]
