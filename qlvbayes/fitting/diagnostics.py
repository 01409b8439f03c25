"""Judge whether a chain can be trusted: R-hat, effective sample size."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from arviz_stats.base import array_stats

LARGEST_R_HAT = 1.05
FEWEST_EFFECTIVE = 400


@dataclass(frozen=True)
class Diagnostics:
    """R-hat and bulk effective sample size (P,) of each constant; NaN if it does not vary."""

    r_hat: np.ndarray
    ess_bulk: np.ndarray

    @property
    def troubles(self) -> list[str]:
        """Return what speaks against the chain, as messages; an empty list if nothing does."""
        messages = []
        varying = np.isfinite(self.r_hat) & np.isfinite(self.ess_bulk)
        worst = float(np.max(self.r_hat[varying], initial=1.0))
        fewest = float(np.min(self.ess_bulk[varying], initial=np.inf))
        if worst > LARGEST_R_HAT:
            messages.append(f"R-hat reaches {worst:.3f}, above {LARGEST_R_HAT}")
        if fewest < FEWEST_EFFECTIVE:
            messages.append(f"only {fewest:.0f} effective samples, below {FEWEST_EFFECTIVE}")
        return messages


def diagnose_chain(chains: np.ndarray) -> Diagnostics:
    """Return split R-hat (rank-normalised) and bulk ESS of draws (chains, draws, P).

    The walkers of an ensemble count as chains. Source: Vehtari et al. 2021, doi:10.1214/20-BA1221.
    """
    r_hat = np.full(chains.shape[-1], np.nan)
    ess = np.full(chains.shape[-1], np.nan)
    for k in np.flatnonzero(np.ptp(chains, axis=(0, 1)) > 0.0):
        values = np.ascontiguousarray(chains[..., k])
        r_hat[k] = array_stats.rhat(values, chain_axis=0, draw_axis=1)
        ess[k] = array_stats.ess(values, chain_axis=0, draw_axis=1, method="bulk")
    return Diagnostics(r_hat, ess)


def highest_density(values: np.ndarray, share: float = 0.9) -> tuple[float, float]:
    """Return the ends of the shortest interval that holds ``share`` of the draws (any shape)."""
    flat = np.sort(np.ravel(values))
    inside = int(np.floor(share * flat.size))
    widths = flat[inside:] - flat[: flat.size - inside]
    start = int(np.argmin(widths))
    return float(flat[start]), float(flat[start + inside])
