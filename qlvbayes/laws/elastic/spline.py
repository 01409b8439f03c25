"""Define stiffness as a free curve over depth, for elasticity that no listed law describes."""

from __future__ import annotations

from typing import Any, ClassVar, Self

from qlvbayes import xp
from qlvbayes.laws.elastic.law import AbstractElastic
from qlvbayes.laws.recursion import in_pieces
from qlvbayes.laws.scales import Scales, lognormal
from qlvbayes.priors.distributions import Constant
from qlvbayes.pytree import static
from qlvbayes.xp import Array

_PIECES = 6  # intervals of depth: they follow a contact halfway to about 1 % of the peak force


class Spline(AbstractElastic):
    r"""Stiffness linear in depth between seven knots, and constant beyond the last.

    .. math:: K(\delta) = k_j + (k_{j+1} - k_j)(\delta - x_j)/h, \quad x_j = j h \le \delta \le
              x_{j+1}, \quad h = \mathrm{depth}/6

    The curve has the form of no law: where it is far more probable than every law, the elasticity
    is none of the list.
    """

    k0: Constant
    k1: Constant
    k2: Constant
    k3: Constant
    k4: Constant
    k5: Constant
    k6: Constant
    depth: float = static()
    name = "spline"
    listed = False
    units: ClassVar[dict[str, str]] = {f"k{j}": "stiffness" for j in range(_PIECES + 1)}
    meanings: ClassVar[dict[str, str]] = {
        f"k{j}": f"stiffness at {j}/{_PIECES} of the largest depth" for j in range(_PIECES + 1)
    }
    law = "K(δ) linear between seven knots"
    reference = "de Boor 1978, A Practical Guide to Splines"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        stiffness = lognormal(scales.force / scales.depth, 5.0)
        knots: dict[str, Any] = dict.fromkeys(cls.units, stiffness)
        return cls(**knots, depth=scales.depth)

    def force(self, depth: Array) -> Array:
        first, rise = self._first, self._rise
        added = self._width * (first + 0.5 * self._width * rise)[1:-1]
        at_knots = xp.concatenate([xp.zeros_like(first[:2]), xp.cumsum(added)])
        return in_pieces(depth, self._width, (at_knots, first, 0.5 * rise))

    def stiffness(self, depth: Array) -> Array:
        rise = self._rise
        return in_pieces(depth, self._width, (self._first, rise, xp.zeros_like(rise)))

    @property
    def _width(self) -> float:
        return self.depth / _PIECES

    @property
    def _first(self) -> Array:
        """Return the (8,) stiffness (N/mm) at which each piece begins."""
        return self._ends[:-1]

    @property
    def _rise(self) -> Array:
        """Return the (8,) slope of the stiffness in each piece (N/mm2)."""
        return xp.diff(self._ends) / self._width

    @property
    def _ends(self) -> Array:
        """Return the (9,) stiffness (N/mm) at the ends of pieces, constant in the outer two."""
        knots = [self.k0, self.k1, self.k2, self.k3, self.k4, self.k5, self.k6]
        return xp.stack([self.k0, *knots, self.k6])
