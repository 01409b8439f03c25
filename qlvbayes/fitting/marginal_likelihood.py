r"""Build the likelihood of a fit: measured noise, and a discrepancy that is summed over.

Sigma is the covariance of the floor. K = B^T B + rho is that of a discrepancy of unit size (see
`discrepancy`), less what the derivatives of the model's force can follow (`separation`), so that
the curve follows the data. Both are made diagonal together: with W Sigma W^T = 1 (of `whitening`)
and the eigenvectors R of

.. math:: W K W^T = R\, \text{diag}(\kappa)\, R^T, \quad A = R^T W.

The dwells leave the floor open: Sigma is the mean over floors that are likely given the dwells
alone (`whitening`), and its scale phi takes the values of draws of them, which are equally likely.
The scales and the sizes of the discrepancy are summed over.

The zero of a test's displacement has an error where its contact was measured, of sd s. It changes
the force by :math:`u = s\, \partial F / \partial \delta_0`, which is common to the test, and to all
tests of a stage where these share one contact, and adds :math:`u u^T` to the floor's covariance.
This is a normal prior on the contact offset, integrated out to first order.

The discrepancy, and a stiffness that differs from test to test (`scatter`), may have moved the
constants by what the derivatives have followed of them. This is
added to each of their draws (`Spread`), as the diagnosis adds it to its normals (`evidence`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from scipy.linalg import solve_triangular

from qlvbayes.effects.contacts import ContactOffset
from qlvbayes.fitting import compiled
from qlvbayes.inference.common_errors import shared_stages, stage_changes, with_common_errors
from qlvbayes.inference.density import Terms, gauss_newton, positive_part
from qlvbayes.inference.errors.discrepancy import Discrepancy
from qlvbayes.inference.errors.features import UNDECIDED
from qlvbayes.inference.errors.separation import Separation
from qlvbayes.inference.evidence import second_moment
from qlvbayes.io.arrays import Array
from qlvbayes.laws.scales import TOLERANCE
from qlvbayes.model.floorlikelihood import FloorLikelihood
from qlvbayes.model.model import Model
from qlvbayes.model.noise import Floor
from qlvbayes.model.posterior import Posterior
from qlvbayes.motion.experiment import Experiment, Trial
from qlvbayes.motion.noisefloor import NoiseFloor
from qlvbayes.motion.record import Blocks, Record

_SCALES = 5  # draws of the floor: its median and 1.3 sds either way
_PRIOR = replace(UNDECIDED, sizes=2 * UNDECIDED.sizes - 1)  # in steps of a fifth


def known_floor(floor: NoiseFloor, noise: Floor) -> NoiseFloor:
    """Return the floor with the values that the user gives, which leave nothing open."""
    given = [float(value) for value in (noise.white, noise.ou, noise.tau)]
    if np.isnan(given).all():
        return floor
    measured = (floor.white, floor.ou, floor.tau)
    white, ou, tau = np.where(np.isnan(given), measured, given).tolist()
    return replace(floor, white=white, ou=ou, tau=tau, dwells=None)


def has_uncertain_zeros(model: Model, trials: Sequence[Trial]) -> bool:
    """Return whether a zero of displacement has a known error and contact is not fitted anyway."""
    measured = any(trial.test.contact_sd for trial in trials)
    return measured and not any(isinstance(effect, ContactOffset) for effect in model.effects)


def with_zero_errors(record: Record, trials: Sequence[Trial], model: Model) -> Record:
    """Return the record of trials with what errors of their zeros change of a model's force."""
    if not has_uncertain_zeros(model, trials):
        return record
    sds = np.array([trial.test.contact_sd or 0.0 for trial in trials])
    further, nearer = (compiled.beyond_gaps(model, record, sign * sds) for sign in (1.0, -1.0))
    changes = 0.5 * (further - nearer)
    own = jnp.asarray([not stage for stage in shared_stages(trials)])[:, None]
    zero, stage = jnp.where(own, changes, 0.0), jnp.where(own, 0.0, changes)
    return replace(record, blocks=replace(record.blocks, zero=zero, stage=stage))


def discrepancy_of(
    experiment: Experiment, trials: Sequence[Trial], blocks: Blocks, noise: Floor
) -> Discrepancy:
    """Return the discrepancy of the block means (T, B) of some trials, under the floor as known."""
    experiment = replace(experiment, floor=known_floor(experiment.floor, noise))
    discrepancy = Discrepancy.from_blocks(experiment, trials, blocks, TOLERANCE, _PRIOR)
    return with_common_errors(discrepancy, stage_changes(trials, blocks))


def floor_likelihood(
    experiment: Experiment,
    trials: Sequence[Trial],
    blocks: Blocks,
    noise: Floor,
    fitted: FitResponse | None = None,
) -> FloorLikelihood:
    """Return the likelihood of the block means (T, B) of some trials."""
    floor = known_floor(experiment.floor, noise)
    discrepancy = discrepancy_of(experiment, trials, blocks, noise)
    shapes, precisions = discrepancy.shapes, discrepancy.whitener.precisions
    smooth = shapes.T @ shapes
    if fitted is not None:
        smooth -= discrepancy.separated(fitted.slopes, np.ones(len(fitted.slopes))).removed
    kappa, axes = np.linalg.eigh(smooth + discrepancy.rough * np.diag(precisions))
    scales, sizes, log_prior = _pairs(floor, noise, discrepancy)
    variances = scales[:, None] ** 2 + sizes[:, None] ** 2 * np.maximum(kappa, 0.0)
    constant = 0.5 * np.sum(np.log(precisions / (2.0 * np.pi)))
    expected = floor.expected()
    known = (np.full(scales.size, value) for value in (expected.white, expected.ou, expected.tau))
    return FloorLikelihood(
        indices=jnp.flatnonzero(jnp.asarray(blocks.real)),
        axes=jnp.asarray(axes.T @ discrepancy.whitener.matrix),
        precisions=jnp.asarray(1.0 / variances),
        heights=jnp.asarray(log_prior + constant - 0.5 * np.log(variances).sum(axis=1)),
        constants=jnp.asarray(np.column_stack([*known, scales, sizes])),
    )


class FitResponse(NamedTuple):
    """The response at a fit: derivatives (D, T, B) of the force, and residuals (T, B) in N."""

    slopes: Array
    residual: Array


@dataclass(frozen=True, eq=False)
class Spread:
    """The covariance of theta about the curve that follows the data, due to a discrepancy."""

    discrepancy: Discrepancy  # of the fitted block means
    vectors: Array  # (1 + D, n): whitened residual, and derivatives of the force
    separation: Separation  # from what these can follow
    prior: Terms  # expansion of minus the log prior density

    @classmethod
    def about(
        cls,
        discrepancy: Discrepancy,
        fitted: FitResponse,
        prior: Terms,
        predicted: Array | None = None,
    ) -> Spread:
        """Return the spread about a fit; prior: expansion of minus the log prior density there.

        predicted (T, B): force (N) whose scale may differ from test to test (`scatter`), by as much
        as is likeliest; None for no such scatter.
        """
        vectors = discrepancy.whitener(np.concatenate([fitted.residual[None], fitted.slopes]))
        parts = None if predicted is None else (lambda: predicted[None])
        separation = discrepancy.separated(fitted.slopes, np.ones(len(fitted.slopes)), parts)
        _, scatter = discrepancy.likeliest(vectors[0], 0.0, separation)
        return cls(discrepancy, vectors, separation.with_scatter(scatter), prior)

    @property
    def scatter(self) -> float:
        """Relative sd of the stiffness from test to test."""
        return max(self.separation.scatter.sizes, default=0.0)

    def covariance(self, size: float) -> Array:
        """Return the covariance (D, D) that a discrepancy of a size (N) and the scatter add."""
        lengths = np.ones(len(self.vectors) - 1)  # of unconstrained parameters
        separated = self.discrepancy.at(size, self.separation)
        precision = gauss_newton(separated, self.vectors, self.prior).curvature
        known: Array = np.asarray(np.linalg.inv(precision + np.diag(lengths**-2.0)), float)
        whole = self.discrepancy.unseparated(size, self.separation)
        free = gauss_newton(whole, self.vectors, self.prior)
        return positive_part(second_moment(free, lengths) - known)

    def draws(self, sizes: Array, rng: np.random.Generator) -> Array:
        """Return moves (W, D) of theta for discrepancies of sizes (W,) in N; 0 for nothing."""
        moves = np.zeros((sizes.size, len(self.vectors) - 1))
        for size in np.unique(sizes if self.scatter > 0.0 else sizes[sizes > 0.0]).tolist():
            values, axes = np.linalg.eigh(self.covariance(size))
            same = sizes == size
            normal = rng.standard_normal((int(same.sum()), values.size))
            moves[same] = normal * np.sqrt(np.maximum(values, 0.0)) @ axes.T
        return moves


def _pairs(floor: NoiseFloor, noise: Floor, discrepancy: Discrepancy) -> tuple[Array, Array, Array]:
    """Return C scales of the floor, sizes of the discrepancy, and log priors, (C,) each."""
    drawn = np.array([one.total for one in floor.draws(_SCALES)])
    scales_drawn = drawn / floor.expected().total
    scales, counts = np.unique(scales_drawn, return_counts=True)
    log_scales = np.log(counts / counts.sum())
    sizes, log_sizes = discrepancy.sizes, discrepancy.log_prior
    if np.isfinite(noise.factor):
        scales, log_scales = np.array([float(noise.factor)]), np.zeros(1)
    if np.isfinite(noise.remainder):
        sizes, log_sizes = np.array([float(noise.remainder)]), np.zeros(1)
    log_prior = log_scales[:, None] + log_sizes
    return np.repeat(scales, sizes.size), np.tile(sizes, scales.size), log_prior.ravel()


class DrawResiduals:
    """The residuals of draws, each with the pair of scale and size that its constants contain.

    Raises KeyError where the constants (N, P) of a draw are not those of a pair.
    """

    def __init__(self, posterior: Posterior, predicted: Array, constants: Array) -> None:
        floor = posterior.floor
        assert floor is not None
        self._axes = np.asarray(floor.axes)
        self._precisions = np.asarray(floor.precisions)
        self._back = np.linalg.inv(self._axes)
        self._indices = np.asarray(floor.indices)
        self._predicted = predicted.reshape(len(predicted), -1)[:, self._indices]
        measured = np.asarray(posterior.record.blocks.force).ravel()[self._indices]
        self._residuals = measured - self._predicted
        pairs = {tuple(row): k for k, row in enumerate(np.asarray(floor.constants).tolist())}
        rows = constants[:, -len(posterior.noise.units) :].tolist()
        self._pairs = np.array([pairs[tuple(row)] for row in rows])
        self._scales = np.asarray(floor.constants)[self._pairs, -2:-1]

    def log_likelihoods(self) -> Array:
        """Return log densities (N, n) of each block mean given the ones before it in the record."""
        logs = np.empty_like(self._residuals)
        for pair in np.unique(self._pairs):
            same = self._pairs == pair
            root = np.linalg.cholesky((self._back / self._precisions[pair]) @ self._back.T)
            errors = solve_triangular(root, self._residuals[same].T, lower=True).T
            heights = np.log(np.diag(root)) + 0.5 * np.log(2.0 * np.pi)
            logs[same] = -0.5 * errors**2 - heights
        return logs

    def replicates(self, rng: np.random.Generator) -> Array:
        """Return block means (N, n) of new noise, with the discrepancy that the data imply."""
        noise_share = self._scales**2 * self._precisions[self._pairs]  # of the variance
        draws = rng.standard_normal((2, *self._residuals.shape))
        white = (1.0 - noise_share) * (self._residuals @ self._axes.T)
        white += self._scales * (np.sqrt(np.maximum(1.0 - noise_share, 0.0)) * draws[0] + draws[1])
        return self._predicted + white @ self._back.T
