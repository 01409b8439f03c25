r"""Define priors of several numbers together: fractions that sum to one, rates in falling order.

Each ``to_*`` maps unconstrained numbers y to the value, and gives log\|d value / d y\| with it.
"""

from __future__ import annotations

from collections.abc import Sequence

import jax
import numpy as np
from jaxtyping import ArrayLike

from qlvbayes import xp
from qlvbayes.priors.distributions import (
    AbstractPositivePrior,
    AbstractPrior,
    AbstractScalarPrior,
    LogNormal,
)
from qlvbayes.pytree import static
from qlvbayes.xp import Array


class Dirichlet(AbstractPrior):
    """Dirichlet prior of fractions that sum to one; some of them may be fixed.

    Where some fractions are fixed, the free ones share the remainder, and their prior is the
    Dirichlet distribution conditional on the fixed values.

    Parameters
    ----------
    alpha
        (k,) concentrations, each above 0; all 1 is uniform over the simplex.
    fixed
        Values of the fixed fractions, by index.
    """

    alpha: Array
    values: Array
    free: tuple[int, ...] = static()

    def __init__(
        self, alpha: Sequence[float] | Array, fixed: dict[int, float] | None = None
    ) -> None:
        self.alpha = xp.asarray(alpha)
        fixed = fixed or {}
        every = range(self.alpha.shape[0])
        self.values = np.array([fixed.get(i, 0.0) for i in every], dtype=float)
        self.free = tuple(i for i in every if i not in fixed)

    @property
    def size(self) -> int:
        """Return the number of free fractions less one."""
        return len(self.free) - 1

    def constrain(self, y: Array) -> tuple[Array, Array]:
        """Return the (k,) fractions at y and the log density over y."""
        free = np.asarray(self.free)
        shares, log_volume = to_simplex(y)
        alpha = xp.along_first(self.alpha[free], shares[0])
        log_density = xp.sum((alpha - 1.0) * xp.log(shares)) + xp.gammaln(alpha.sum())
        rest = 1.0 - self.values.sum()
        values = [self.values[k] for k in range(self.values.shape[0])]
        for k, share in zip(self.free, shares, strict=True):
            values[k] = rest * share
        fractions = xp.stack(values)
        return fractions, log_density - xp.gammaln(alpha).sum() + log_volume

    def unconstrain(self, value: ArrayLike) -> Array:
        """Return the unconstrained numbers whose fractions are ``value``, shape (k,)."""
        shares = xp.asarray(value)[np.asarray(self.free)]
        return from_simplex(shares / shares.sum())

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """Return (k,) fractions that are drawn from the prior."""
        values = np.array(self.values)
        free = list(self.free)
        values[free] = (1.0 - values.sum()) * rng.dirichlet(np.asarray(self.alpha)[free])
        return values

    def describe(self) -> str:
        """Return ``dirichlet(a, b, ...)`` with the fixed fractions after it."""
        text = f"dirichlet({', '.join(f'{a:.4g}' for a in np.asarray(self.alpha))})"
        fixed = [i for i in range(self.alpha.shape[0]) if i not in self.free]
        return text + "".join(f", [{i}] = {float(self.values[i]):.4g}" for i in fixed)


class Ordered(AbstractPrior):
    """Joint prior of positive rates in falling order, one each; some of them may be fixed.

    The density is the product of the members' priors wherever the rates fall, normalised there by
    the probability of that order, which is integrated numerically once. The order keeps relaxation
    modes from exchanging their labels.

    Parameters
    ----------
    members
        One positive prior or one number (1/s) for each rate, the fastest first.
    """

    members: tuple[AbstractPositivePrior | Array, ...]
    log_normaliser: Array

    def __init__(self, members: tuple[AbstractPositivePrior | float, ...]) -> None:
        self.members = tuple(
            x if isinstance(x, AbstractScalarPrior) else xp.asarray(x) for x in members
        )
        key = tuple((type(x), *map(float, jax.tree.leaves(x))) for x in self.members)
        if key not in _PROBABILITIES:
            _PROBABILITIES[key] = _probability_of_order(self.members)
        self.log_normaliser = np.asarray(np.log(_PROBABILITIES[key]))

    @property
    def size(self) -> int:
        """Return the number of free rates."""
        return sum(isinstance(x, AbstractScalarPrior) for x in self.members)

    def constrain(self, y: Array) -> tuple[Array, Array]:
        """Return the (r,) falling rates at y and the log density over y."""
        logs: list[Array] = []  # they stay finite where a rate overflows
        total = -self.log_normaliser
        taken = 0
        for index, member in enumerate(self.members):
            if isinstance(member, AbstractScalarPrior):
                low, high = self._bounds(index, logs)
                log_value, log_volume = to_between(y[taken], low, high)
                density = member.log_density(xp.exp(log_value))
                total = total + density + log_value + log_volume
                taken += 1
            else:
                log_value = xp.log(member)
            logs.append(log_value)
        # a fixed rate keeps its last digit
        pairs = zip(self.members, logs, strict=True)
        rates = [xp.exp(y) if isinstance(x, AbstractScalarPrior) else x for x, y in pairs]
        return xp.stack(rates), total

    def unconstrain(self, value: ArrayLike) -> Array:
        """Return the unconstrained numbers whose rates are ``value``, shape (r,), falling."""
        logs = list(xp.log(xp.asarray(value)))
        free = [
            from_between(logs[index], *self._bounds(index, logs[:index]))
            for index, member in enumerate(self.members)
            if isinstance(member, AbstractScalarPrior)
        ]
        return xp.stack(free) if free else np.zeros(0)

    def _bounds(self, index: int, before: list[Array]) -> tuple[Array | None, Array | None]:
        """Return the logs of the next fixed rate below and of the rate just above, or None."""
        below = [x for x in self.members[index + 1 :] if not isinstance(x, AbstractScalarPrior)]
        low = xp.log(below[0]) if below else None
        return low, (before[-1] if before else None)

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """Return (r,) falling rates; draws in another order are rejected."""
        while True:
            rates = np.array(
                [x.draw(rng) if isinstance(x, AbstractScalarPrior) else x for x in self.members],
                dtype=float,
            )
            if np.all(np.diff(rates) < 0.0):
                return rates

    def describe(self) -> str:
        """Return the members' descriptions, joined by ``>``."""
        return " > ".join(
            x.describe() if isinstance(x, AbstractScalarPrior) else f"{float(x):.4g}"
            for x in self.members
        )


_PROBABILITIES: dict[tuple, float] = {}  # of the order, by the members: each takes 20 ms
_NARROW = 0.05  # log sd below which the grid needs points of its own around the median


def _probability_of_order(members: tuple[AbstractPositivePrior | Array, ...]) -> float:
    """Return the probability that independent draws of the free members fall in order."""
    fixed = [float(np.log(x)) for x in members if not isinstance(x, AbstractScalarPrior)]
    around = [
        np.asarray(x.log_median) + np.asarray(x.log_sd) * np.linspace(-10.0, 10.0, 4001)
        for x in members
        if isinstance(x, LogNormal) and np.asarray(x.log_sd) < _NARROW
    ]
    wide = np.linspace(-60.0, 60.0, 24001)
    grid = np.unique(np.concatenate([wide, *around, fixed, [x + 1e-12 for x in fixed]]))
    below = np.ones_like(grid)
    for member in reversed(members):
        if not isinstance(member, AbstractScalarPrior):
            log_rate = float(np.log(member))
            below = np.where(grid > log_rate, np.interp(log_rate, grid, below), 0.0)
            continue
        with np.errstate(over="ignore", invalid="ignore"):
            density = np.exp(np.asarray(member.log_density(np.exp(grid))) + grid)
        density = np.nan_to_num(density)
        weight = density * below
        steps = 0.5 * (weight[1:] + weight[:-1]) * np.diff(grid)
        below = np.concatenate([[0.0], np.cumsum(steps)])
    return float(below[-1])


def to_simplex(y: Array) -> tuple[Array, Array]:
    """Map (k - 1,) numbers to (k,) positive fractions that sum to one, by stick-breaking."""
    pieces = y.shape[0]
    shifted = y - xp.along_first(np.log(np.arange(pieces, 0, -1.0)), y.sum(axis=0))
    log_break, log_keep = xp.log_sigmoid(shifted), xp.log_sigmoid(-shifted)
    log_left = xp.concatenate([np.zeros(1), xp.cumsum(log_keep)])
    fractions = xp.exp(xp.concatenate([log_left[:-1] + log_break, log_left[-1:]]))
    return fractions, xp.sum(log_left[:-1] + log_break + log_keep)


def from_simplex(fractions: ArrayLike) -> Array:
    """Return the (k - 1,) numbers that ``to_simplex`` maps to these (k,) fractions."""
    shares: Array = xp.asarray(fractions)
    pieces = shares.shape[0] - 1
    after = xp.cumsum(shares[::-1])[::-1][1:]
    count = xp.along_first(np.log(np.arange(pieces, 0, -1.0)), shares[0])
    return xp.log(shares[:-1]) - xp.log(after) + count


def to_between(y: Array, low: Array | None, high: Array | None) -> tuple[Array, Array]:
    """Return x between ``low`` and ``high``, where either may be None, and the log-Jacobian."""
    if low is None and high is None:
        return y, xp.zeros_like(y)
    if high is None:
        return low + xp.exp(y), y
    if low is None:
        return high - xp.exp(y), y
    width = xp.asarray(high) - low
    log_volume = xp.log(width) + xp.log_sigmoid(y) + xp.log_sigmoid(-y)
    return low + width * xp.sigmoid(y), log_volume


def from_between(x: Array, low: Array | None, high: Array | None) -> Array:
    """Return the y that ``to_between(y, low, high)`` maps to x."""
    if low is None and high is None:
        return x
    if high is None:
        return xp.log(x - low)
    if low is None:
        return xp.log(high - x)
    return xp.log(x - low) - xp.log(high - x)
