r"""The part of a discrepancy that a model's own slopes can follow, made independent of the rest.

Beside a smooth discrepancy of covariance s^2 K the likeliest curve need not follow the data: where
the constants bend it away, what is missed elsewhere is more probable. With P the projection on the
rows of the Jacobian J, orthogonal in plain squared error over the block means,

.. math:: P = J^T (J J^T)^{-1} J, \quad K_P = (1 - P) K (1 - P) + \kappa\, P K P,

nothing that is missed says any more where the curve should be: the constants are those of least
squares as far as misfit goes (Zyskind 1967, doi:10.1214/aoms/1177698779; L2 calibration, Tuo & Wu
2015, doi:10.1214/15-AOS1314; orthogonal Gaussian processes, Plumlee 2017,
doi:10.1080/01621459.2016.1211016). P K P, which keeps its share kappa, is by what a discrepancy may
have moved the constants before the data are seen. With kappa = 1 their posterior is wider by that.
With kappa = 0 it is that of the curve which follows the data, and the spread is added where the
constants are reported (`evidence`). Evidence is the same either way, as far as priors are wide.

So it is, with kappa = 1, with the variances T of what is not known of moments (`timing`): a reading
next to a kink may be off, and no curve is bent beside a discrepancy to leave it so.

With Q an orthonormal basis of P, the difference to C = Sigma + T + s^2 K has a low rank,

.. math:: C_P = C - Q^T Y - Y^T Q = C - U^T S U, \quad
          Y = s^2 Q K (1 - \tfrac{1 + \kappa}{2} P) + Q T (1 - P), \quad U = (Q; Y), \quad
          S = \begin{pmatrix} 0 & 1 \\ 1 & 0 \end{pmatrix}

so that with the inverse and determinant of C at hand those of C_P follow (Woodbury):

.. math:: C_P^{-1} = C^{-1} + C^{-1} U^T M^{-1} U C^{-1}, \quad
          M = S - U C^{-1} U^T, \quad |C_P| = |C|\, |M|
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_SMALLEST = 1e-8
"""Singular value of the scaled Jacobian, over the largest, below which it is rounding."""


def orthonormal_rows(slopes: Array, lengths: Array) -> Array:
    """(R, n) an orthonormal basis of what slopes (F, n) of the plain block means span.

    lengths (F,): natural ones of the free numbers, by which slopes are scaled; what no number moves
    is left out.
    """
    _, values, rows = np.linalg.svd(slopes * lengths[:, None], full_matrices=False)
    kept: Array = rows[values > _SMALLEST * values.max(initial=0.0)]
    return kept


@dataclass(frozen=True, eq=False)
class Separation:
    """Of the discrepancy of one Jacobian, computed when a size above nothing asks for it.

    slopes (F, n): of the plain block means; lengths (F,): natural ones of the free numbers; tied:
    from Q (R, n) the parts Y of K and of the moments, both (R, n); whiten: (M, n) block means.
    """

    slopes: Array
    lengths: Array
    tied: Callable[[Array], tuple[Array, Array]]
    whiten: Callable[[Array], Array]
    _sized: dict[float, Separated] = field(default_factory=dict)

    @cached_property
    def rows(self) -> Array:
        """(R, n) Q."""
        return orthonormal_rows(self.slopes, self.lengths)

    @cached_property
    def _parts(self) -> tuple[Array, ...]:
        """Q, Y of K and Y of the moments, whitened, (R, n) each."""
        parts = np.concatenate([self.rows, *self.tied(self.rows)])
        return tuple(np.split(self.whiten(parts), 3))

    @property
    def rank(self) -> int:
        """R."""
        return len(self.rows)

    @property
    def removed(self) -> Array:
        """(n, n) K - K_P, whitened."""
        basis, ties, _ = self._parts
        product = basis.T @ ties
        return np.asarray(product + product.T)

    def forget_but(self, size: float) -> None:
        """Keep what was computed of one size (N) only: of all, a point holds megabytes."""
        for other in [known for known in self._sized if known != size]:
            self._sized.pop(other, None)

    def at(self, plain: Sized) -> Sized | Separated:
        """Of the size of a discrepancy that is not separated."""
        if plain.size == 0.0 or not self.rank:
            return plain
        found = self._sized.get(plain.size)
        if found is None:
            basis, ties, moments = self._parts
            tied = plain.size**2 * ties + moments
            found = self._sized[plain.size] = Separated.from_plain(plain, basis, tied)
        return found


@dataclass(frozen=True, eq=False)
class Sized:
    """A discrepancy of one size s (N): C^-1 = root (1 - axes^T axes) root, in whitened numbers.

    root (n,): D^(-1/2); axes (M, n); log_volume: ln|C|.
    """

    size: float
    root: Array
    axes: Array
    log_volume: float

    def products(self, vectors: Array) -> Array:
        """(M, M) v^T C^-1 w of whitened vectors (M, n)."""
        own, parts = self.parts(vectors)
        return np.asarray(own @ own.T - parts @ parts.T)

    def squares(self, vectors: Array) -> Array:
        """(M,) v^T C^-1 v."""
        own, parts = self.parts(vectors)
        return np.asarray((own**2).sum(axis=1) - (parts**2).sum(axis=1))

    def parts(self, vectors: Array) -> tuple[Array, Array]:
        """Scaled vectors (M, n) and what of them the axes take."""
        own = vectors * self.root
        return own, own @ self.axes.T


@dataclass(frozen=True, eq=False)
class Separated:
    """The same for C_P.

    plain: for K; own, parts: of U; core (2R, 2R): M; log_volume: ln of the determinant.
    """

    plain: Sized
    own: Array
    parts: Array
    core: Array
    log_volume: float

    @classmethod
    def from_plain(cls, plain: Sized, basis: Array, tied: Array) -> Self:
        """Of Q and Y (R, n), whitened."""
        scale = plain.size  # both alike in size: for the digits
        own, parts = plain.parts(np.concatenate([scale * basis, tied / scale]))
        rank = len(basis)
        swap = np.roll(np.eye(2 * rank), rank, axis=0)
        core = swap - (own @ own.T - parts @ parts.T)
        log_volume = plain.log_volume + float(np.linalg.slogdet(core)[1])
        return cls(plain, own, parts, core, log_volume)

    @property
    def size(self) -> float:
        """The discrepancy's size (N)."""
        return self.plain.size

    @cached_property
    def inverse(self) -> Array:
        """(2R, 2R) M^-1."""
        return np.asarray(np.linalg.inv(self.core))

    def products(self, vectors: Array) -> Array:
        """(M, M) v^T C^-1 w of whitened vectors (M, n)."""
        own, parts = self.plain.parts(vectors)
        with_u = own @ self.own.T - parts @ self.parts.T
        return np.asarray(own @ own.T - parts @ parts.T + with_u @ self.inverse @ with_u.T)

    def squares(self, vectors: Array) -> Array:
        """(M,) v^T C^-1 v."""
        own, parts = self.plain.parts(vectors)
        with_u = own @ self.own.T - parts @ self.parts.T
        found = (own**2).sum(axis=1) - (parts**2).sum(axis=1)
        return np.asarray(found + np.einsum("mu,uw,mw->m", with_u, self.inverse, with_u))
