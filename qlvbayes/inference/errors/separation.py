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
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from qlvbayes.inference.errors.scatter import NONE, Scatter
from qlvbayes.io.arrays import Array

_SMALLEST = 1e-8
"""Singular values of the scaled Jacobian below this share of the largest are rounding."""

_OF_SLOPES = ("slopes", "rows", "_parts", "scaled_rows", "separated_rows")
"""What is computed once, and does not depend on the errors of the force;"""
_CACHED = (*_OF_SLOPES, "_whitened_errors")
"""and all of it, which does not depend on the scatter."""


def orthonormal_rows(slopes: Array, lengths: Array) -> Array:
    """Return an orthonormal basis (R, n) of the span of slopes (F, n) of the block means."""
    _, values, rows = np.linalg.svd(slopes * lengths[:, None], full_matrices=False)
    basis: Array = rows[values > _SMALLEST * values.max(initial=0.0)]
    return basis


@dataclass(frozen=True, eq=False)
class Separation:
    """The separation of a discrepancy for one Jacobian, computed when a size above zero needs it.

    derivatives: function to those of the block means (F, n), not whitened; lengths (F,): natural
    lengths of the free parameters; coupled: function from Q (R, n) to the parts Y of K and of the
    moments, both (R, n); whiten: function that whitens block means (M, n); scaled: function to the
    rows V (K, n) of the parts of the force whose scale differs between tests, not whitened, and the
    group (K,) of each;
    scatter: the relative sds of the scales of each group; errors (K, n): independent errors of the
    force, not whitened, each one sd, which are not separated.
    """

    derivatives: Callable[[], Array]
    lengths: Array
    coupled: Callable[[Array], tuple[Array, Array]]
    whiten: Callable[[Array], Array]
    scaled: Callable[[], tuple[Array, NDArray[np.intp]]] | None = None
    scatter: Scatter = NONE
    errors: Array | None = None
    _by_size: dict[float, Separated] = field(default_factory=dict)

    @cached_property
    def slopes(self) -> Array:
        """Return the derivatives of the block means (F, n), not whitened."""
        return self.derivatives()

    @cached_property
    def rows(self) -> Array:
        """Return the orthonormal basis Q (R, n)."""
        return orthonormal_rows(self.slopes, self.lengths)

    @cached_property
    def _parts(self) -> tuple[Array, ...]:
        """Return Q, Y of K and Y of the moments, (R, n) each, whitened."""
        parts = np.concatenate([self.rows, *self.coupled(self.rows)])
        return tuple(np.split(self.whiten(parts), 3))

    @cached_property
    def scaled_rows(self) -> tuple[Array, NDArray[np.intp]]:
        """Return the rows V (K, n), not whitened, and the group (K,) of each."""
        if self.scaled is None:
            return np.zeros((0, self.slopes.shape[1])), np.zeros(0, dtype=np.intp)
        return self.scaled()

    @cached_property
    def separated_rows(self) -> Array:
        """Return V (1 - P), (K, n), whitened: as a discrepancy, scatter bends no curve."""
        rows, _ = self.scaled_rows
        return self.whiten(rows - (rows @ self.rows.T) @ self.rows)

    def scattered(self, rows: Array) -> Array:
        """Return the rows (K, n) of V, in any form, times the sds of their scales."""
        if not any(self.scatter.sizes):
            return rows[:0]
        return np.asarray(np.array(self.scatter.sizes)[self.scaled_rows[1], None] * rows)

    def unseparated(self, discrepancy: DiscrepancyOfSize) -> DiscrepancyOfSize | Separated:
        """Return a discrepancy with the scatter, neither of them separated."""
        if not self.has_rows:
            return discrepancy
        rows = self._with_errors(self.scattered(self.whiten(self.scaled_rows[0])))
        return Separated.from_unseparated(discrepancy, rows[:0], rows[:0], rows, 0.0)

    @property
    def has_rows(self) -> bool:
        """True if there is scatter, or are errors of the force."""
        return any(self.scatter.sizes) or (self.errors is not None and len(self.errors) > 0)

    @cached_property
    def _whitened_errors(self) -> Array:
        return self.slopes[:0] if self.errors is None else self.whiten(self.errors)

    def _with_errors(self, rows: Array) -> Array:
        return np.concatenate([rows, self._whitened_errors])

    def with_scatter(self, scatter: Scatter) -> Separation:
        """Return the separation with other sds of the scales of each group."""
        return self if scatter == self.scatter else self._changed(_CACHED, scatter=scatter)

    def with_errors(self, errors: Array | None) -> Separation:
        """Return the separation with other errors of the force."""
        if errors is self.errors:
            return self
        return self._changed(_OF_SLOPES, errors=errors)

    def _changed(self, known: tuple[str, ...], **fields: Any) -> Separation:
        """Return the separation with other fields, on which what is known does not depend."""
        other = replace(self, _by_size={}, **fields)
        other.__dict__.update({k: v for k, v in self.__dict__.items() if k in known})
        return other

    @property
    def rank(self) -> int:
        """Return the rank R of the Jacobian."""
        return len(self.rows)

    @property
    def removed(self) -> Array:
        """Return K - K_P (n, n), whitened."""
        basis, ties, _ = self._parts
        product = basis.T @ ties
        return np.asarray(product + product.T)

    def forget(self) -> None:
        """Discard what can be computed again in a millisecond, to save a megabyte a point."""
        self._by_size.clear()
        for rows in _CACHED:
            self.__dict__.pop(rows, None)

    def at(self, unseparated: DiscrepancyOfSize) -> DiscrepancyOfSize | Separated:
        """Return the separated discrepancy, with the scatter, of one that is not separated."""
        separates = unseparated.size > 0.0 and self.rank > 0
        if not separates and not self.has_rows:
            return unseparated
        known = self._by_size.get(unseparated.size)
        if known is None:
            basis, ties, moments = self._parts if separates else 3 * (self.slopes[:0],)
            coupled = unseparated.size**2 * ties + moments
            scattered = self._with_errors(self.scattered(self.separated_rows))
            known = Separated.from_unseparated(
                unseparated, basis, coupled, scattered, 2.0 * self.scatter.cost
            )
            self._by_size[unseparated.size] = known
        return known


@dataclass(frozen=True, eq=False)
class DiscrepancyOfSize:
    """A discrepancy of one size s (N), not separated: C^-1 = root (1 - axes^T axes) root.

    The matrices act on whitened block means. root (n,): D^(-1/2); axes (M, n); log_volume: ln|C|.
    """

    size: float
    root: Array
    axes: Array
    log_volume: float

    def products(self, vectors: Array) -> Array:
        """Return the products v^T C^-1 w (M, M) of whitened vectors (M, n)."""
        scaled, projected = self.parts(vectors)
        return np.asarray(scaled @ scaled.T - projected @ projected.T)

    def squares(self, vectors: Array) -> Array:
        """Return v^T C^-1 v (M,) of whitened vectors (M, n)."""
        scaled, projected = self.parts(vectors)
        return np.asarray((scaled**2).sum(axis=1) - (projected**2).sum(axis=1))

    def parts(self, vectors: Array) -> tuple[Array, Array]:
        """Return the scaled vectors (M, n) and their components (M, K) along the K axes."""
        scaled = vectors * self.root
        return scaled, scaled @ self.axes.T


@dataclass(frozen=True, eq=False)
class Separated:
    """A separated discrepancy of one size, with the covariance C_P."""

    unseparated: DiscrepancyOfSize  # the discrepancy of covariance C
    # own (2R, n), parts: scaled U and its components along the axes
    own: Array
    parts: Array
    core: Array  # (2R, 2R): M
    log_volume: float  # ln|C_P|

    @classmethod
    def from_unseparated(
        cls,
        unseparated: DiscrepancyOfSize,
        basis: Array,
        coupled: Array,
        scattered: Array,
        cost: float,
    ) -> Self:
        """Return the separated discrepancy of Q and Y (R, n) and scaled V (K, n), whitened."""
        scale = unseparated.size or 1.0  # makes Q and Y of similar size, which saves digits
        rows = np.concatenate([scale * basis, coupled / scale, scattered])
        own, parts = unseparated.parts(rows)
        rank = len(basis)
        inner = -np.eye(len(rows))
        inner[: 2 * rank, : 2 * rank] = np.roll(np.eye(2 * rank), rank, axis=0)
        core = inner - (own @ own.T - parts @ parts.T)
        log_volume = unseparated.log_volume + float(np.linalg.slogdet(core)[1]) + cost
        return cls(unseparated, own, parts, core, log_volume)

    @property
    def size(self) -> float:
        """Return the size (N) of the discrepancy."""
        return self.unseparated.size

    @cached_property
    def inverse(self) -> Array:
        """Return M^-1 (2R + K, 2R + K)."""
        return np.asarray(np.linalg.inv(self.core))

    def products(self, vectors: Array) -> Array:
        """Return the products v^T C_P^-1 w (M, M) of whitened vectors (M, n)."""
        scaled, projected = self.unseparated.parts(vectors)
        with_u = scaled @ self.own.T - projected @ self.parts.T
        return np.asarray(
            scaled @ scaled.T - projected @ projected.T + with_u @ self.inverse @ with_u.T
        )

    def squares(self, vectors: Array) -> Array:
        """Return v^T C_P^-1 v (M,) of whitened vectors (M, n)."""
        scaled, projected = self.unseparated.parts(vectors)
        with_u = scaled @ self.own.T - projected @ self.parts.T
        unseparated = (scaled**2).sum(axis=1) - (projected**2).sum(axis=1)
        return np.asarray(unseparated + np.einsum("mu,uw,mw->m", with_u, self.inverse, with_u))
