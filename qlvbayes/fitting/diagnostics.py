"""Whether a chain can be trusted: R-hat, effective samples, autocorrelation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from arviz_stats.base import array_stats

LARGEST_R_HAT = 1.05
FEWEST_EFFECTIVE = 400


@dataclass(frozen=True)
class Diagnostics:
    """R-hat and bulk effective sample size of each constant; NaN for those that do not vary."""

    r_hat: np.ndarray
    ess_bulk: np.ndarray

    @property
    def troubles(self) -> list[str]:
        """What speaks against the chain, in words; empty where nothing does."""
        found = []
        varying = np.isfinite(self.r_hat) & np.isfinite(self.ess_bulk)
        worst = float(np.max(self.r_hat[varying], initial=1.0))
        fewest = float(np.min(self.ess_bulk[varying], initial=np.inf))
        if worst > LARGEST_R_HAT:
            found.append(f"R-hat reaches {worst:.3f}, above {LARGEST_R_HAT}")
        if fewest < FEWEST_EFFECTIVE:
            found.append(f"only {fewest:.0f} effective samples, below {FEWEST_EFFECTIVE}")
        return found


def diagnose_chain(chains: np.ndarray) -> Diagnostics:
    """Split R-hat (rank-normalised) and bulk ESS of (chains, draws, P) numbers.

    Vehtari et al. 2021, doi:10.1214/20-BA1221, with an ensemble's walkers as the chains.
    """
    r_hat = np.full(chains.shape[-1], np.nan)
    ess = np.full(chains.shape[-1], np.nan)
    for k in np.flatnonzero(np.ptp(chains, axis=(0, 1)) > 0.0):
        values = np.ascontiguousarray(chains[..., k])
        r_hat[k] = array_stats.rhat(values, chain_axis=0, draw_axis=1)
        ess[k] = array_stats.ess(values, chain_axis=0, draw_axis=1, method="bulk")
    return Diagnostics(r_hat, ess)


def highest_density(values: np.ndarray, share: float = 0.9) -> tuple[float, float]:
    """Shortest interval that holds ``share`` of the draws (any shape)."""
    flat = np.sort(np.ravel(values))
    inside = int(np.floor(share * flat.size))
    widths = flat[inside:] - flat[: flat.size - inside]
    start = int(np.argmin(widths))
    return float(flat[start]), float(flat[start + inside])
