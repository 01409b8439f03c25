r"""From a pad's tests to the likelihood of a fit: measured noise, and a discrepancy summed over.

The covariance of the floor, Sigma, and of a discrepancy of unit size, K = B^T B + rho (of
`discrepancy`), less what the model's slopes can follow (`separation`), so that the curve follows
the data, are made diagonal together: with W Sigma W^T = 1 (of `whitening`) and the eigenvectors R
of

.. math:: W K W^T = R\, \text{diag}(\kappa)\, R^T, \quad A = R^T W.

The dwells leave the floor's scale open: its equally likely values phi are those of draws of the
floor given the dwells alone. They and the sizes of the discrepancy are summed over.

The zero of each test's displacement has an error of its own where its contact was measured, of sd
s: a change of the force by :math:`u = s\, \partial F / \partial \delta_0`, alike over the test and
independent of the others', which adds :math:`u u^T` to the floor's covariance. It is a normal
prior on each test's contact offset, summed over to first order.

By how much what the slopes have followed may have moved the constants is added to each draw of
them (`Spread`), as the diagnosis adds it to its normals (`evidence`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from qlvbayes.effects.contact_offset import ContactOffset
from qlvbayes.fitting import compiled
from qlvbayes.inference.errors.discrepancy import Discrepancy
from qlvbayes.inference.errors.features import UNDECIDED
from qlvbayes.inference.errors.separation import Separation
from qlvbayes.inference.evidence import beyond, moved
from qlvbayes.laws.scales import TOLERANCE
from qlvbayes.model.floorlikelihood import FloorLikelihood
from qlvbayes.model.noise import Floor
from qlvbayes.model.posterior import Posterior
from qlvbayes.preprocess.experiment import Experiment, Trial
from qlvbayes.preprocess.noisefloor import NoiseFloor
from qlvbayes.preprocess.record import Blocks

Array = NDArray[np.float64]

_SCALES = 5  # draws of the floor: a median and 1.3 sds either way
_PRIOR = replace(UNDECIDED, sizes=2 * UNDECIDED.sizes - 1)  # steps of a fifth: the size is told


def known_floor(floor: NoiseFloor, noise: Floor) -> NoiseFloor:
    """The floor with what the user knows of it, which leaves nothing open."""
    given = [float(value) for value in (noise.white, noise.ou, noise.tau)]
    if np.isnan(given).all():
        return floor
    measured = (floor.white, floor.ou, floor.tau)
    white, ou, tau = np.where(np.isnan(given), measured, given).tolist()
    return replace(floor, white=white, ou=ou, tau=tau, dwells=None)


def zero_errors(posterior: Posterior, trials: Sequence[Trial], theta: Array) -> Array | None:
    """(T, B) change of the force for one standard error of each test's zero of displacement.

    None where no test's was measured, or where contact is fitted anyway.
    """
    sds = np.array([trial.test.contact_sd or 0.0 for trial in trials])
    model, _, _ = posterior.bind(jnp.asarray(theta))
    if not sds.any() or any(isinstance(effect, ContactOffset) for effect in model.effects):
        return None
    record = posterior.record
    further, nearer = (compiled.beyond_gaps(model, record, sign * sds) for sign in (1.0, -1.0))
    return 0.5 * (np.asarray(further) - np.asarray(nearer))


def discrepancy_of(
    experiment: Experiment,
    trials: Sequence[Trial],
    blocks: Blocks,
    noise: Floor,
    zeros: Array | None = None,
) -> Discrepancy:
    """Of block means (T, B) of some trials of a pad, under its floor as the user knows it.

    zeros (T, B): what the errors of the tests' zeros make, which count as part of the floor.
    """
    experiment = replace(experiment, floor=known_floor(experiment.floor, noise))
    made = Discrepancy.on(experiment, trials, blocks, TOLERANCE, _PRIOR)
    if zeros is None:
        return made
    own = made.whitener
    changes = [change[real] for change, real in zip(zeros, own.blocks, strict=True)]
    covariances = [c + np.outer(u, u) for c, u in zip(own.covariances, changes, strict=True)]
    return made.under(replace(own, covariances=tuple(covariances)))


def floor_likelihood(
    experiment: Experiment,
    trials: Sequence[Trial],
    blocks: Blocks,
    noise: Floor,
    fitted: Fitted | None = None,
    zeros: Array | None = None,
) -> FloorLikelihood:
    """Of block means (T, B) of some trials of a pad.

    fitted: where the fit is, from whose slopes the discrepancy is separated; None where that is not
    known yet; zeros: as of `discrepancy_of`.
    """
    floor = known_floor(experiment.floor, noise)
    made = discrepancy_of(experiment, trials, blocks, noise, zeros)
    shapes, precisions = made.shapes, made.whitener.precisions
    smooth = shapes.T @ shapes
    if fitted is not None:
        smooth -= made.separated(fitted.slopes, np.ones(len(fitted.slopes))).removed
    kappa, turn = np.linalg.eigh(smooth + made.rough * np.diag(precisions))
    scales, sizes, log_prior = _pairs(floor, noise, made)
    variances = scales[:, None] ** 2 + sizes[:, None] ** 2 * np.maximum(kappa, 0.0)
    constant = 0.5 * np.sum(np.log(precisions / (2.0 * np.pi)))
    known = (np.full(scales.size, value) for value in (floor.white, floor.ou, floor.tau))
    return FloorLikelihood(
        indices=jnp.flatnonzero(jnp.asarray(blocks.real)),
        axes=jnp.asarray(turn.T @ made.whitener.matrix),
        precisions=jnp.asarray(1.0 / variances),
        heights=jnp.asarray(log_prior + constant - 0.5 * np.log(variances).sum(axis=1)),
        constants=jnp.asarray(np.column_stack([*known, scales, sizes])),
    )


class Fitted(NamedTuple):
    """A fit: slopes (D, T, B) of the force along the free numbers, and what it leaves (T, B)."""

    slopes: Array
    residual: Array


@dataclass(frozen=True, eq=False)
class Spread:
    """By how much what is missed may have moved the free numbers from where the curve follows data.

    discrepancy: of the block means that were fitted, of which a fit has the whitened residual (n,)
    and slopes (D, n); separation: from what those can follow; gradient (D,), curvature (D, D): of
    minus the log prior, where the fit is.
    """

    discrepancy: Discrepancy
    residual: Array
    slopes: Array
    separation: Separation
    gradient: Array
    curvature: Array

    @classmethod
    def about(cls, made: Discrepancy, fitted: Fitted, gradient: Array, curvature: Array) -> Spread:
        """About a fit, of minus whose log prior gradient (D,) and curvature (D, D) are known."""
        residual = made.whitener(fitted.residual[None])[0]
        separation = made.separated(fitted.slopes, np.ones(len(fitted.slopes)))
        slopes = made.whitener(fitted.slopes)
        return cls(made, residual, slopes, separation, gradient, curvature)

    def covariance(self, size: float) -> Array:
        """(D, D) beside a discrepancy of a size (N) above 0: what the curve's own does not hold."""
        lengths = np.ones(len(self.slopes))  # of unconstrained numbers
        vectors = np.concatenate([self.residual[None], self.slopes])
        products = self.discrepancy.at(size).products(vectors)
        followed = self.discrepancy.at(size, self.separation).products(self.slopes)
        gradient, curvature = self.gradient - products[1:, 0], self.curvature + products[1:, 1:]
        second = moved(gradient, curvature, lengths)
        precision = followed + self.curvature + np.diag(lengths**-2)
        known: Array = np.linalg.inv(precision).astype(np.float64)
        return beyond(second, known)

    def draws(self, sizes: Array, rng: np.random.Generator) -> Array:
        """(W, D) of discrepancies of some sizes (W,) in N: nothing where that is 0."""
        found = np.zeros((sizes.size, len(self.slopes)))
        for size in np.unique(sizes[sizes > 0.0]).tolist():
            values, axes = np.linalg.eigh(self.covariance(size))
            at = sizes == size
            normal = rng.standard_normal((int(at.sum()), values.size))
            found[at] = normal * np.sqrt(np.maximum(values, 0.0)) @ axes.T
        return found


def _pairs(floor: NoiseFloor, noise: Floor, made: Discrepancy) -> tuple[Array, Array, Array]:
    """(C,) scales of the floor, sizes of the discrepancy, and log priors; what is given is sure.

    Draws of the floor given the dwells are equally likely; alike ones stand once.
    """
    found = np.array([one.total for one in floor.draws(_SCALES)]) / floor.total
    scales, counts = np.unique(found, return_counts=True)
    log_scales = np.log(counts / counts.sum())
    sizes, log_sizes = made.sizes, made.log_prior
    if np.isfinite(noise.factor):
        scales, log_scales = np.array([float(noise.factor)]), np.zeros(1)
    if np.isfinite(noise.remainder):
        sizes, log_sizes = np.array([float(noise.remainder)]), np.zeros(1)
    log_prior = log_scales[:, None] + log_sizes
    return np.repeat(scales, sizes.size), np.tile(sizes, scales.size), log_prior.ravel()


class Judged:
    """Residuals (N, T, B) of draws, each with the pair of scale and size that its constants have.

    Raises KeyError where a draw's constants (N, P) are not those of a pair.
    """

    def __init__(self, posterior: Posterior, predicted: Array, constants: Array) -> None:
        floor = posterior.floor
        assert floor is not None
        self._axes = np.asarray(floor.axes)
        self._precisions = np.asarray(floor.precisions)
        self._back = np.linalg.inv(self._axes)
        self._places = np.asarray(floor.indices)
        self._predicted = predicted.reshape(len(predicted), -1)[:, self._places]
        measured = np.asarray(posterior.record.blocks.force).ravel()[self._places]
        self._residuals = measured - self._predicted
        pairs = {tuple(row): k for k, row in enumerate(np.asarray(floor.constants).tolist())}
        rows = constants[:, -len(posterior.noise.units) :].tolist()
        self._pairs = np.array([pairs[tuple(row)] for row in rows])
        self._scales = np.asarray(floor.constants)[self._pairs, -2:-1]

    def log_likelihoods(self) -> Array:
        """(N, n) log density of each block mean given the ones before it, in the record's order."""
        found = np.empty_like(self._residuals)
        for pair in np.unique(self._pairs):
            own = self._pairs == pair
            root = np.linalg.cholesky((self._back / self._precisions[pair]) @ self._back.T)
            errors = solve_triangular(root, self._residuals[own].T, lower=True).T
            heights = np.log(np.diag(root)) + 0.5 * np.log(2.0 * np.pi)
            found[own] = -0.5 * errors**2 - heights
        return found

    def replicates(self, rng: np.random.Generator) -> Array:
        """(N, n) block means with the discrepancy that the measured ones imply, and new noise."""
        left = self._scales**2 * self._precisions[self._pairs]  # share of a variance that is noise
        draws = rng.standard_normal((2, *self._residuals.shape))
        white = (1.0 - left) * (self._residuals @ self._axes.T)
        white += self._scales * (np.sqrt(np.maximum(1.0 - left, 0.0)) * draws[0] + draws[1])
        return self._predicted + white @ self._back.T
