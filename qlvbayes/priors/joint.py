"""Priors of several numbers together: fractions that sum to one, rates in order."""

from __future__ import annotations

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import gammaln
from jaxtyping import Array, ArrayLike

from qlvbayes.priors.distributions import AbstractPositivePrior, AbstractPrior, LogNormal
from qlvbayes.priors.transforms import from_between, from_simplex, to_between, to_simplex


class Dirichlet(AbstractPrior):
    """Dirichlet over fractions that sum to one, some of which may be fixed.

    alpha: (k,) concentrations; fixed: values by place. With some fixed, the free ones
    share what is left, with the Dirichlet conditioned on the fixed values.
    """

    alpha: Array
    values: Array
    free: tuple[int, ...] = eqx.field(static=True)

    def __init__(
        self, alpha: Sequence[float] | Array, fixed: dict[int, float] | None = None
    ) -> None:
        self.alpha = jnp.asarray(alpha, dtype=float)
        values = np.zeros(self.alpha.shape[0])
        for index, value in (fixed or {}).items():
            values[index] = value
        self.values = jnp.asarray(values)
        self.free = tuple(i for i in range(values.size) if i not in (fixed or {}))

    @property
    def size(self) -> int:
        """One less than the free fractions."""
        return len(self.free) - 1

    def constrain(self, y: Array) -> tuple[Array, Array]:
        """(k,) fractions and the log density over y."""
        free = np.asarray(self.free)
        shares, log_volume = to_simplex(y)
        alpha = self.alpha[free]
        log_density = jnp.sum((alpha - 1.0) * jnp.log(shares)) + gammaln(alpha.sum())
        rest = 1.0 - self.values.sum()
        fractions = self.values.at[free].set(rest * shares)
        return fractions, log_density - gammaln(alpha).sum() + log_volume

    def unconstrain(self, value: ArrayLike) -> Array:
        """Numbers whose fractions are ``value``."""
        shares = jnp.asarray(value, dtype=float)[np.asarray(self.free)]
        return from_simplex(shares / shares.sum())

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """(k,) fractions."""
        values = np.array(self.values)
        free = list(self.free)
        values[free] = (1.0 - values.sum()) * rng.dirichlet(np.asarray(self.alpha)[free])
        return values

    def describe(self) -> str:
        """dirichlet(a, b, ...), and what is fixed."""
        text = f"dirichlet({', '.join(f'{a:.4g}' for a in np.asarray(self.alpha))})"
        fixed = [i for i in range(self.alpha.shape[0]) if i not in self.free]
        return text + "".join(f", [{i}] = {float(self.values[i]):.4g}" for i in fixed)


class Ordered(AbstractPrior):
    """Positive rates in falling order, each with its own prior or fixed to a number.

    The density is the product of the members' priors within the order, normalised there (the
    normalising probability is integrated once, numerically). The order removes the exchange of
    labels between relaxation modes.
    """

    members: tuple[AbstractPositivePrior | Array, ...]
    log_normaliser: Array

    def __init__(self, members: tuple[AbstractPositivePrior | float, ...]) -> None:
        self.members = tuple(
            x if isinstance(x, AbstractPrior) else jnp.asarray(x, dtype=float) for x in members
        )
        self.log_normaliser = jnp.asarray(np.log(_probability_of_order(self.members)))

    @property
    def size(self) -> int:
        """The number of free rates."""
        return sum(isinstance(x, AbstractPrior) for x in self.members)

    def constrain(self, y: Array) -> tuple[Array, Array]:
        """(r,) rates, falling, and the log density over y."""
        logs: list[Array] = []  # they stay finite where a rate overflows
        total = -self.log_normaliser
        taken = 0
        for place, member in enumerate(self.members):
            if isinstance(member, AbstractPrior):
                low, high = self._bounds(place, logs)
                log_value, log_volume = to_between(y[taken], low, high)
                density = member.log_density(jnp.exp(log_value))
                total = total + density + log_value + log_volume
                taken += 1
            else:
                log_value = jnp.log(member)
            logs.append(log_value)
        return self._rates(logs), total

    def _rates(self, logs: list[Array]) -> Array:
        """(r,) rates of their logarithms; a fixed one to its last digit."""
        pairs = zip(self.members, logs, strict=True)
        return jnp.stack([jnp.exp(y) if isinstance(x, AbstractPrior) else x for x, y in pairs])

    def unconstrain(self, value: ArrayLike) -> Array:
        """Numbers whose rates are ``value`` (falling)."""
        logs = list(jnp.log(jnp.asarray(value, dtype=float)))
        numbers = [
            from_between(logs[place], *self._bounds(place, logs[:place]))
            for place, member in enumerate(self.members)
            if isinstance(member, AbstractPrior)
        ]
        return jnp.stack(numbers) if numbers else jnp.zeros(0)

    def _bounds(self, place: int, before: list[Array]) -> tuple[Array | None, Array | None]:
        """Logs of the next fixed rate below and, the last of those before, just above, or None."""
        below = [x for x in self.members[place + 1 :] if not isinstance(x, AbstractPrior)]
        low = jnp.log(below[0]) if below else None
        return low, (before[-1] if before else None)

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """(r,) rates, falling, by rejection."""
        while True:
            rates = np.array(
                [
                    float(x.draw(rng)) if isinstance(x, AbstractPrior) else float(x)
                    for x in self.members
                ]
            )
            if np.all(np.diff(rates) < 0.0):
                return rates

    def describe(self) -> str:
        """Members in order."""
        return " > ".join(
            x.describe() if isinstance(x, AbstractPrior) else f"{float(x):.4g}"
            for x in self.members
        )


_NARROW = 0.05  # log sd below which the grid needs points of its own around the median


def _probability_of_order(members: tuple[AbstractPositivePrior | Array, ...]) -> float:
    """Probability that independent draws of the free members fall in order.

    On a grid of log-rates: p_k(x) = density_k(x) P(all later ones are below x), from the last.
    """
    fixed = [float(np.log(x)) for x in members if not isinstance(x, AbstractPrior)]
    around = [
        np.asarray(x.log_median) + np.asarray(x.log_sd) * np.linspace(-10.0, 10.0, 4001)
        for x in members
        if isinstance(x, LogNormal) and np.asarray(x.log_sd) < _NARROW
    ]
    wide = np.linspace(-60.0, 60.0, 24001)
    grid = np.unique(np.concatenate([wide, *around, fixed, [x + 1e-12 for x in fixed]]))
    below = np.ones_like(grid)
    for member in reversed(members):
        if not isinstance(member, AbstractPrior):
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
