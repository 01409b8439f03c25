r"""Make a discrepancy independent of what a model's own derivatives can follow.

Given a smooth discrepancy of covariance s^2 K, the likeliest curve need not follow the data: where
the constants bend it away from them, the error elsewhere may become more probable. Let P be the
orthogonal projection, in unweighted squared error over the block means, on the rows of the Jacobian
J,

.. math:: P = J^T (J J^T)^{-1} J, \quad K_P = (1 - P) K (1 - P).

With K_P in place of K the discrepancy no longer affects where the curve lies: the constants are
those of least squares as far as misfit goes (Zyskind 1967, doi:10.1214/aoms/1177698779; L2
calibration, Tuo & Wu 2015, doi:10.1214/15-AOS1314; orthogonal Gaussian processes, Plumlee 2017,
doi:10.1080/01621459.2016.1211016). The part P K P that is left out describes by how much a
discrepancy may have moved the constants. The posterior of the constants is therefore that of the
curve which follows the data, and this spread is added where constants are reported (`evidence`).
The evidence is the same with or without P K P as far as priors are wide.

The variances T of uncertain moments (`timing`) are treated likewise, but keep their part P T P: a
reading next to a kink may be off, and no curve should bend to follow it or to avoid it.

With Q an orthonormal basis of P, the difference to C = Sigma + T + s^2 K has a low rank,

.. math:: C_P = C - Q^T Y - Y^T Q = C - U^T S U, \quad
          Y = s^2 Q K (1 - \tfrac12 P) + Q T (1 - P), \quad U = (Q; Y), \quad
          S = \begin{pmatrix} 0 & 1 \\ 1 & 0 \end{pmatrix}

so that the inverse and determinant of C_P follow from those of C (Woodbury), where scatter between
tests (`scatter`) adds further rows V to U, and -1 to the diagonal of S:

.. math:: C_P^{-1} = C^{-1} + C^{-1} U^T M^{-1} U C^{-1}, \quad
          M = S - U C^{-1} U^T, \quad |C_P| = |C|\, |M|
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from qlvbayes.inference.errors.scatter import NONE, Scatter, by_test
from qlvbayes.inference.errors.whitening import Whitener
from qlvbayes.io.arrays import Array

_SMALLEST = 1e-8
"""Singular values of the scaled Jacobian below this share of the largest are rounding."""


@dataclass(frozen=True, eq=False)
class DiscrepancyOfSize:
    """A discrepancy of one size s (N), with the covariance C or, where it is separated, C_P.

    The matrices act on whitened block means. C^-1 = root (1 - axes^T axes) root, with root (n,):
    D^(-1/2), and axes (M, n). log_volume: ln of the determinant. separating: scaled U (U, n), its
    components along the axes (U, M), and M^-1 (U, U), none of which has rows where C_P is C.
    """

    size: float
    root: Array
    axes: Array
    log_volume: float
    separating: tuple[Array, Array, Array]

    @classmethod
    def whole(cls, size: float, root: Array, axes: Array, log_volume: float) -> DiscrepancyOfSize:
        """Return a discrepancy that is not separated."""
        none = np.zeros((0, root.size)), np.zeros((0, len(axes))), np.zeros((0, 0))
        return cls(size, root, axes, log_volume, none)

    def separated(
        self, basis: Array, coupled: Array, scattered: Array, cost: float
    ) -> DiscrepancyOfSize:
        """Return it separated by Q and Y (R, n), with scaled V (K, n), all whitened."""
        scale = self.size or 1.0  # makes Q and Y of similar size, which saves digits
        own = np.concatenate([scale * basis, coupled / scale, scattered]) * self.root
        along = own @ self.axes.T
        rank = len(basis)
        inner = -np.eye(len(own))
        inner[: 2 * rank, : 2 * rank] = np.roll(np.eye(2 * rank), rank, axis=0)
        core = inner - (own @ own.T - along @ along.T)
        log_volume = self.log_volume + float(np.linalg.slogdet(core)[1]) + cost
        separating = own, along, np.asarray(np.linalg.inv(core), float)
        return replace(self, log_volume=log_volume, separating=separating)

    def products(self, vectors: Array) -> Array:
        """Return the products v^T C_P^-1 w (M, M) of whitened vectors (M, n)."""
        scaled, along, with_u = self._components(vectors)
        followed = with_u @ self.separating[2] @ with_u.T
        return np.asarray(scaled @ scaled.T - along @ along.T + followed)

    def squares(self, vectors: Array) -> Array:
        """Return v^T C_P^-1 v (M,) of whitened vectors (M, n)."""
        scaled, along, with_u = self._components(vectors)
        followed = np.einsum("mu,uw,mw->m", with_u, self.separating[2], with_u)
        return np.asarray((scaled**2).sum(axis=1) - (along**2).sum(axis=1) + followed)

    def _components(self, vectors: Array) -> tuple[Array, Array, Array]:
        """Return vectors (M, n) scaled, and their components along the axes and with C^-1 U."""
        scaled = vectors * self.root
        along = scaled @ self.axes.T
        own, own_along, _ = self.separating
        return scaled, along, scaled @ own.T - along @ own_along.T


@dataclass(frozen=True, eq=False)
class Separation:
    """The separation of a discrepancy for one Jacobian, computed when a size above zero needs it.

    features (M, n): of the discrepancy, not whitened; responses (F, T, B), lengths (F,):
    derivatives of the block means, and natural lengths of the free parameters; parts: function to
    the parts (G, T, B) of the force whose scale differs between tests; scatter: the relative sds
    of the scales of each part; errors (K, n): independent errors of the force, not whitened, each
    one sd, which are not separated.
    """

    whitener: Whitener
    features: Array
    responses: Array
    lengths: Array
    parts: Callable[[], Array] | None = None
    scatter: Scatter = NONE
    errors: Array | None = None
    _by_size: dict[float, DiscrepancyOfSize] = field(default_factory=dict)

    @cached_property
    def rows(self) -> Array:
        """Return the orthonormal basis Q (R, n) of the span of the derivatives."""
        slopes = self.whitener.flattened(self.responses) * self.lengths[:, None]
        _, values, rows = np.linalg.svd(slopes, full_matrices=False)
        return np.asarray(rows[values > _SMALLEST * values.max(initial=0.0)])

    @cached_property
    def _parts(self) -> tuple[Array, ...]:
        """Return Q, Y of K and Y of the moments, (R, n) each, whitened."""
        smooth = (self.rows @ self.features.T) @ self.features
        smooth -= 0.5 * (smooth @ self.rows.T) @ self.rows
        parts = np.concatenate([self.rows, smooth, self._coupled_moments])
        return tuple(np.split(self.whitener.whiten(parts), 3))

    @property
    def _coupled_moments(self) -> Array:
        """Return Q T (1 - P), (R, n), where T holds the variances of uncertain moments."""
        return self._rest(self.rows * np.concatenate(self.whitener.timing))

    def _rest(self, vectors: Array) -> Array:
        """Return vectors (M, n) without what the derivatives can follow of them."""
        return np.asarray(vectors - (vectors @ self.rows.T) @ self.rows)

    @cached_property
    def scaled_rows(self) -> tuple[Array, NDArray[np.intp]]:
        """Return the rows V (K, n), not whitened, and the part (K,) of each."""
        if self.parts is None:
            return np.zeros((0, self.features.shape[1])), np.zeros(0, dtype=np.intp)
        parts = self.parts()
        groups = np.repeat(np.arange(len(parts)), parts.shape[1])
        return self.whitener.flattened(by_test(parts)), groups

    @cached_property
    def separated_rows(self) -> Array:
        """Return V (1 - P), (K, n), whitened: as a discrepancy, scatter bends no curve."""
        return self.whitener.whiten(self._rest(self.scaled_rows[0]))

    def scattered(self, rows: Array) -> Array:
        """Return the rows (K, n) of V, in any form, times the sds of their scales."""
        if not any(self.scatter.sizes):
            return rows[:0]
        return np.asarray(np.array(self.scatter.sizes)[self.scaled_rows[1], None] * rows)

    def with_scatter(self, scatter: Scatter) -> Separation:
        """Return the separation with other sds of the scales of each part."""
        return self if scatter == self.scatter else replace(self, scatter=scatter, _by_size={})

    def with_errors(self, errors: Array | None) -> Separation:
        """Return the separation with other errors of the force."""
        return self if errors is self.errors else replace(self, errors=errors, _by_size={})

    @property
    def removed(self) -> Array:
        """Return K - K_P (n, n), whitened."""
        basis, ties, _ = self._parts
        product = basis.T @ ties
        return np.asarray(product + product.T)

    def covariance(self, size: float, rough: float) -> Array:
        """Return the covariance (n, n) that a size (N) and the scatter add (N^2)."""
        scaled = self._rest(self.scattered(self.scaled_rows[0]))
        between: Array = scaled.T @ scaled
        if self.errors is not None:
            between += self.errors.T @ self.errors
        if size == 0.0:
            return between
        rest, moments = self._rest(self.features), self.rows.T @ self._coupled_moments
        added = size**2 * (rest.T @ rest + rough * np.eye(rest.shape[1]))
        return np.asarray(added + between - moments - moments.T)

    def forget(self) -> None:
        """Discard what can be computed again in a millisecond, to save a megabyte a point."""
        self._by_size.clear()
        for computed in self.__dict__.keys() - {one.name for one in fields(self)}:
            del self.__dict__[computed]

    def at(self, whole: DiscrepancyOfSize) -> DiscrepancyOfSize:
        """Return a discrepancy separated, with the scatter and the errors of the force."""
        separates = whole.size > 0.0 and len(self.rows) > 0
        if not separates and not self._has_rows:
            return whole
        if whole.size not in self._by_size:
            basis, ties, moments = self._parts if separates else 3 * (self.rows[:0],)
            self._by_size[whole.size] = whole.separated(
                basis,
                whole.size**2 * ties + moments,
                self._with_errors(self.separated_rows),
                2.0 * self.scatter.cost,
            )
        return self._by_size[whole.size]

    def unseparated(self, whole: DiscrepancyOfSize) -> DiscrepancyOfSize:
        """Return a discrepancy with the scatter, neither of them separated."""
        if not self._has_rows:
            return whole
        rows = self._with_errors(self.whitener.whiten(self.scaled_rows[0]))
        return whole.separated(rows[:0], rows[:0], rows, 0.0)

    @property
    def _has_rows(self) -> bool:
        """True if there is scatter, or are errors of the force."""
        return any(self.scatter.sizes) or (self.errors is not None and len(self.errors) > 0)

    def _with_errors(self, rows: Array) -> Array:
        """Return whitened rows of V, scaled, and the errors of the force after them."""
        scaled = self.scattered(rows)
        whiten = self.whitener.whiten
        return scaled if self.errors is None else np.concatenate([scaled, whiten(self.errors)])
