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

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import jax
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.special import logsumexp, softmax

from qlvbayes.effects.contacts import ContactOffset
from qlvbayes.inference.density import Point, positive_part
from qlvbayes.inference.errors.discrepancy import Discrepancy
from qlvbayes.inference.errors.features import UNDECIDED
from qlvbayes.inference.errors.separation import Separation
from qlvbayes.inference.errors.whitening import shared_stages
from qlvbayes.inference.evidence import second_moment
from qlvbayes.inference.forward.forces import Forces
from qlvbayes.io.arrays import Array
from qlvbayes.laws.scales import TOLERANCE
from qlvbayes.model.model import Model
from qlvbayes.model.noise import Floor, White
from qlvbayes.motion.experiment import Experiment, Trial
from qlvbayes.motion.noisefloor import NoiseFloor
from qlvbayes.motion.record import Blocks, Record, held
from qlvbayes.priors.distributions import AbstractScalarPrior

_SCALES = 5  # draws of the floor: its median and 1.3 sds either way
_PRIOR = replace(UNDECIDED, sizes=2 * UNDECIDED.sizes - 1)  # in steps of a fifth
_VALUES = 201  # of an independent noise's sd that are summed over
_FACTOR = 1e4  # by which that sd may lie off the measured noise
_NEGLIGIBLE = 40.0  # log density below the largest from which a value is left out


@dataclass(frozen=True, eq=False)
class NoiseLikelihood:
    r"""The likelihood of one record of n block means, for many residuals at once.

    The noise floor has the covariance :math:`\phi^2 \Sigma` and the discrepancy :math:`s^2 K`, of
    which only the scale :math:`\phi` and the size s are unknown. With :math:`A \Sigma A^T = 1` and
    :math:`A K A^T = \text{diag}(\kappa)`, residuals r of n block means become independent, z = A r,
    at any scale and size, and

    .. math:: \ln L = \ln \sum_{\phi, s} p(\phi) p(s) \exp\left(-\tfrac12 \sum_j \left[
              \frac{z_j^2}{\phi^2 + s^2 \kappa_j} + \ln (\phi^2 + s^2 \kappa_j) \right]\right)
              - \tfrac12 \ln |2 \pi \Sigma|

    Under independent noise (``--noise white``) the block means are independent as they are, A = 1,
    and the sum is over the values of its sd.
    """

    real: NDArray[np.bool_]  # (T, B): the n block means that are not padding
    axes: Array  # (n, n): A, in 1/N
    precisions: Array  # (C, n): 1/variance of z for each of C choices of scale and size
    noise: Array  # (C, n) or (C, 1): the part of that variance that is noise
    heights: Array  # (C,): log likelihood and log prior of a choice without the sum of squares
    constants: Array  # (C, Q): the noise's constants for each choice, in the order of its fields

    def white(self, vectors: Array) -> Array:
        """Return z (K, n) of block means (K, T, B) in N."""
        return np.asarray(vectors[:, self.real] @ self.axes.T)

    def log_choices(self, white: Array) -> Array:
        """Return (K, C) logarithms of likelihood times prior of each choice, for z (K, n)."""
        return np.asarray(self.heights - 0.5 * (white**2 @ self.precisions.T))

    def log_likelihood(self, residuals: Array) -> Array:
        """Return the log likelihoods (K,) of residuals (K, T, B) in N, all tests together."""
        logs = self.log_choices(self.white(residuals))
        largest = logs.max(axis=1)  # scipy's function of this name takes ten times as long
        return np.asarray(largest + np.log(np.exp(logs - largest[:, None]).sum(axis=1)))

    def drawn(self, residuals: Array, shares: Array) -> Array:
        """Return the constants (K, Q) of the choice at a share (K,), 0 to 1, of their posterior."""
        logs = self.log_choices(self.white(residuals))
        below = np.cumsum(softmax(logs, axis=1), axis=1)
        index = np.sum(below < (shares * below[:, -1])[:, None], axis=1)
        return np.asarray(self.constants[np.minimum(index, len(self.constants) - 1)])

    def choices_of(self, constants: Array) -> NDArray[np.intp]:
        """Return the choices (K,) of the noise's constants (K, Q); KeyError where there is none."""
        known = {tuple(row): k for k, row in enumerate(self.constants.tolist())}
        return np.array([known[tuple(row)] for row in constants.tolist()])

    def conditional(self, residuals: Array, choices: NDArray[np.intp]) -> Array:
        """Return log densities (K, n) of each block mean given those before it in the record."""
        flat, back = residuals[:, self.real], np.linalg.inv(self.axes)
        logs = np.empty_like(flat)
        for choice in np.unique(choices):
            same = choices == choice
            root = np.linalg.cholesky((back / self.precisions[choice]) @ back.T)
            errors = solve_triangular(root, flat[same].T, lower=True).T
            logs[same] = -0.5 * errors**2 - np.log(np.diag(root)) - 0.5 * np.log(2.0 * np.pi)
        return logs

    def replicates(
        self, residuals: Array, choices: NDArray[np.intp], rng: np.random.Generator
    ) -> Array:
        """Return new errors (K, n) in N: new noise, and the discrepancy that residuals imply."""
        noise = self.noise[choices]
        share = noise * self.precisions[choices]
        draws = rng.standard_normal((2, *share.shape))
        left = np.sqrt(np.maximum(1.0 - share, 0.0))
        white = (1.0 - share) * self.white(residuals)
        white += np.sqrt(noise) * (left * draws[0] + draws[1])
        return np.asarray(white @ np.linalg.inv(self.axes).T)


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
    return measured and not any(effect.name == ContactOffset.name for effect in model.effects)


def with_zero_errors(record: Record, trials: Sequence[Trial], model: Model) -> Record:
    """Return the record of trials with what errors of their zeros change of a model's force."""
    if not has_uncertain_zeros(model, trials):
        return record
    sds = np.array([trial.test.contact_sd or 0.0 for trial in trials])
    gaps = np.concatenate([sds, -sds])
    sets = jax.tree.map(lambda x: np.repeat(np.asarray(x)[..., None], gaps.size, -1), model)
    forces = Forces().over(sets + ContactOffset(gaps), gaps.size, record)
    further, nearer = (forces[k * sds.size :][range(sds.size), range(sds.size)] for k in (0, 1))
    changes = 0.5 * (further - nearer)
    own = np.array([not stage for stage in shared_stages(trials)])[:, None]
    zero, stage = held(np.where(own, changes, 0.0)), held(np.where(own, 0.0, changes))
    return replace(record, blocks=replace(record.blocks, zero=zero, stage=stage))


def discrepancy_of(
    experiment: Experiment, trials: Sequence[Trial], blocks: Blocks, noise: Floor
) -> Discrepancy:
    """Return the discrepancy of the block means (T, B) of some trials, under the floor as known.

    A size that the user gives is the only one that has a probability.
    """
    experiment = replace(experiment, floor=known_floor(experiment.floor, noise))
    discrepancy = Discrepancy.from_blocks(experiment, trials, blocks, TOLERANCE, _PRIOR)
    if np.isfinite(size := float(noise.remainder)):
        sizes, logs = ([0.0, size], [-np.inf, 0.0]) if size > 0.0 else ([0.0], [0.0])
        discrepancy = replace(discrepancy, sizes=np.array(sizes), log_prior=np.array(logs))
    return discrepancy


def floor_likelihood(
    experiment: Experiment,
    noise: Floor,
    discrepancy: Discrepancy,
    separation: Separation | None = None,
) -> NoiseLikelihood:
    """Return the likelihood of the block means that a discrepancy is of, by `discrepancy_of`."""
    floor, whitener = known_floor(experiment.floor, noise), discrepancy.whitener
    shapes, precisions = discrepancy.shapes, whitener.precisions
    smooth = shapes.T @ shapes
    if separation is not None:
        smooth -= separation.removed
    kappa, axes = np.linalg.eigh(smooth + discrepancy.rough * np.diag(precisions))
    drawn = np.array([one.total for one in floor.draws(_SCALES)])
    scales, counts = np.unique(drawn / floor.expected().total, return_counts=True)
    log_scales = np.log(counts / counts.sum())
    if np.isfinite(noise.factor):
        scales, log_scales = np.array([float(noise.factor)]), np.zeros(1)
    probable = np.isfinite(discrepancy.log_prior)
    log_prior = (log_scales[:, None] + discrepancy.log_prior[probable]).ravel()
    pairs = np.meshgrid(scales, discrepancy.sizes[probable], indexing="ij")
    scales, sizes = (values.ravel() for values in pairs)
    variances = scales[:, None] ** 2 + sizes[:, None] ** 2 * np.maximum(kappa, 0.0)
    constant = 0.5 * np.sum(np.log(precisions / (2.0 * np.pi)))
    expected = floor.expected()
    known = (np.full(scales.size, value) for value in (expected.white, expected.ou, expected.tau))
    return NoiseLikelihood(
        np.stack(whitener.blocks),
        axes.T @ whitener.matrix,
        1.0 / variances,
        scales[:, None] ** 2,
        log_prior + constant - 0.5 * np.log(variances).sum(axis=1),
        np.column_stack([*known, scales, sizes]),
    )


def white_likelihood(
    noise: White, blocks: Blocks, level: float, residual: Array | None = None
) -> NoiseLikelihood:
    """Return the likelihood of block means (T, B) under independent noise.

    A free sd is summed over values that are likely given the residual (T, B) of a fit. level: the
    measured noise (N).
    """
    real = np.asarray(blocks.real)
    fields = (blocks.count, blocks.weight, blocks.scale, blocks.extra, blocks.timing)
    count, weight, scale, extra, timing = (np.asarray(one)[real] for one in fields)
    shares, others = (weight * scale) ** 2 / count, extra**2 + timing**2
    squares = np.zeros(count.size) if residual is None else residual[real] ** 2
    level = max(level, float(np.sqrt(np.mean(squares / shares))))

    def heights(sds: Array) -> tuple[Array, Array]:
        variances = sds[:, None] ** 2 * shares + others
        return variances, -0.5 * np.log(2.0 * np.pi * variances).sum(axis=1)

    def log_likelihood(sds: Array) -> Array:
        variances, height = heights(sds)
        return height - 0.5 * (squares / variances).sum(axis=1)

    sds, log_prior = _sds(noise.white, level, log_likelihood)
    variances, height = heights(sds)
    axes, constants = np.eye(count.size), sds[:, None]
    return NoiseLikelihood(real, axes, 1.0 / variances, variances, height + log_prior, constants)


def _sds(
    white: object, level: float, log_likelihood: Callable[[Array], Array]
) -> tuple[Array, Array]:
    """Return the values (C,) that an independent noise's sd may have, and their log priors."""
    if not isinstance(white, AbstractScalarPrior):
        return np.array([float(white)]), np.zeros(1)  # type: ignore[arg-type]
    logs = math.log(level) + np.linspace(-1.0, 1.0, _VALUES) * math.log(_FACTOR)
    for _ in range(4):  # each time over the values that are left
        sds = np.exp(logs)
        log_prior = np.asarray(white.log_density(sds)) + logs
        density = log_prior + log_likelihood(sds)
        left = np.flatnonzero(density > density.max() - _NEGLIGIBLE)
        low, high = logs[max(left[0] - 1, 0)], logs[min(left[-1] + 1, _VALUES - 1)]
        logs = np.linspace(low, high, _VALUES)
    return sds, log_prior - logsumexp(log_prior)


@dataclass(frozen=True, eq=False)
class Spread:
    """The covariance of theta about the curve that follows the data, due to a discrepancy."""

    discrepancy: Discrepancy  # of the fitted block means
    point: Point  # the fit, separated from what its derivatives of the force can follow

    @classmethod
    def about(cls, discrepancy: Discrepancy, point: Point) -> Spread:
        """Return the spread about a fit, where the force's scale may differ from test to test.

        It differs by as much as is likeliest, if the discrepancy has a prior of that (`scatter`).
        """
        separation = discrepancy.separated(
            point.responses, point.own.length, lambda: point.predicted[None]
        )
        _, scatter = discrepancy.likeliest(point.residual, 0.0, separation)
        return cls(discrepancy, replace(point, separation=separation.with_scatter(scatter)))

    @property
    def scatter(self) -> float:
        """Relative sd of the stiffness from test to test."""
        return max(self.point.separation.scatter.sizes, default=0.0)

    def covariance(self, size: float) -> Array:
        """Return the covariance (D, D) that a discrepancy of a size (N) and the scatter add."""
        point, whole = self.point, self.discrepancy.at(size)
        lengths = point.own.length
        precision = point.terms(point.separation.at(whole)).curvature
        known: Array = np.asarray(np.linalg.inv(precision + np.diag(lengths**-2.0)), float)
        free = point.terms(point.separation.unseparated(whole))
        return positive_part(second_moment(free, lengths) - known)

    def draws(self, sizes: Array, rng: np.random.Generator) -> Array:
        """Return moves (W, D) of theta for discrepancies of sizes (W,) in N; 0 for nothing."""
        moves = np.zeros((sizes.size, self.point.theta.size))
        for size in np.unique(sizes if self.scatter > 0.0 else sizes[sizes > 0.0]).tolist():
            values, axes = np.linalg.eigh(self.covariance(size))
            same = sizes == size
            normal = rng.standard_normal((int(same.sum()), values.size))
            moves[same] = normal * np.sqrt(np.maximum(values, 0.0)) @ axes.T
        return moves
