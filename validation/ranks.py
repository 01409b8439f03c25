"""Simulation-based calibration: is the truth's rank among the posterior's draws uniform?

Constants of a pad and its noise are drawn from the priors that the fit is given, a test is
simulated by differential equations, written to a CSV file, read and fitted. Over many pads the rank
of each true constant among independent draws of its posterior is uniform if file, reader, motion,
reduction, force, likelihood, priors and sampler are right together (Talts et al. 2018,
arXiv:1804.06788). The noise is a tenth of the peak force and more, so that priors count.

Two more series are fitted without the log-Jacobians of the priors' coordinates, and as if
noise were forgotten from one block mean to the next: either must fail. Interrupted, the same
command goes on where it was.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, partial
from math import log
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray
from results import JOBS, Origin, Table, finished
from scipy.stats import binom, chi2, f

from qlvbayes.fitting.ensemble import Settings
from qlvbayes.fitting.fit import Fit, fit_pad
from qlvbayes.io.data import read_measurements
from qlvbayes.model.choices import Choices
from qlvbayes.motion.experiment import prepare
from qlvbayes.simulate import Constants, Noise, simulate_study, write_csv

RATE = 20.0  # mm/s, of the one test
ROWS = 120  # of a test; a noise floor is measured in its rests
DRAWS = 99  # of a posterior, among which the truth has one of a hundred ranks
MOST_STEPS = 6000  # fewer than the default, as a fit that needs more would take minutes
LEVEL = 0.01  # of the test of uniform ranks, over all constants of a kind of noise together
_SHARES = (6.0, 10.0, 3.0)
_LOGNORMAL = {
    "m": (log(0.5), 0.4),  # N/mm
    "b": (log(0.7), 0.4),  # 1/mm
    "v[1]": (log(5.0), 0.4),  # 1/s
    "v[2]": (log(0.15), 0.4),
}
_NOISE = {
    "noise.white": (log(0.1), 0.2),  # N, of a peak force of about 1.5 N
    "noise.ou": (log(0.1), 0.3),
    "noise.tau": (log(2.0), 0.3),  # s
}
"""Median's logarithm and log sd of each prior; the simulation draws from these."""


@dataclass(frozen=True)
class Kind:
    """A series of pads, by what is broken on purpose."""

    broken: str = ""

    @property
    def name(self) -> str:
        """A name for files."""
        return "ranks-floor" + (f"-broken-{self.broken}" if self.broken else "")

    @property
    def choices(self) -> Choices:
        """The model under the priors that the truth is drawn from."""
        priors = [f"{name}=lognormal({a!r},{b!r})" for name, (a, b) in _LOGNORMAL.items()]
        return Choices(priors=(*priors, f"c=dirichlet{_SHARES}"))


def drawn(rng: np.random.Generator) -> tuple[Constants, Noise]:
    """Draw a pad and its noise, by numpy alone."""
    while True:
        own = {name: rng.lognormal(*prior) for name, prior in (_LOGNORMAL | _NOISE).items()}
        if own["v[1]"] > own["v[2]"]:
            break
    shares = tuple(rng.dirichlet(_SHARES).tolist())
    pad = Constants(own["m"], own["b"], shares, (own["v[1]"], own["v[2]"]))
    return pad, Noise(own["noise.white"], own["noise.ou"], own["noise.tau"])


def run(kind: Kind, seed: int, index: int) -> dict[str, Any]:
    """Return the ranks of a pad's constants; the pad depends on seed and index only.

    What is to be broken stays so in this process.
    """
    if kind.broken:
        break_once(kind.broken)
    rng = np.random.default_rng([seed, index])
    truth, noise = drawn(rng)
    with TemporaryDirectory() as folder:
        file = Path(folder) / "pad.csv"
        simulated = int(rng.integers(2**32))
        tests = simulate_study({"pad": truth}, [RATE], noise, simulated, ROWS)
        write_csv(file, tests, ["ranks"])
        pad = read_measurements(file).pad("pad")
        fit = fit_pad(
            prepare(pad), kind.choices, settings=Settings(seed=index, max_steps=MOST_STEPS)
        )
    values = {"m": truth.m, "b": truth.b}
    values |= {f"c[{k}]": c for k, c in enumerate(truth.c)}
    values |= {f"v[{k}]": v for k, v in enumerate(truth.v, start=1)}
    return {"index": index, "converged": bool(fit.enough), "ranks": _ranks(fit, values, rng)}


def _ranks(fit: Fit, truth: dict[str, float], rng: np.random.Generator) -> dict[str, int]:
    """Number of draws below the truth, of draws so few among many that they are independent."""
    draws = fit.every.reshape(-1, fit.every.shape[-1])
    some = draws[rng.choice(len(draws), DRAWS, replace=False)]
    below = dict(zip(fit.names, map(int, _below(some, fit.names, truth)), strict=False))
    return {name: below[name] for name in truth}


def _below(
    draws: NDArray[np.float64], names: Sequence[str], truth: dict[str, float]
) -> NDArray[np.int64]:
    own = np.array([truth.get(name, np.nan) for name in names])
    return np.asarray((draws < own).sum(axis=0))


def break_jacobian() -> None:
    """Let the maps from unconstrained numbers lose their log-Jacobians."""
    from qlvbayes.priors import joint

    simplex, between = joint.to_simplex, joint.to_between
    joint.to_simplex = lambda y: (simplex(y)[0], 0.0)  # type: ignore[assignment,return-value]

    def lost(y: Any, low: Any, high: Any) -> tuple[Any, Any]:
        x, _ = between(y, low, high)
        return x, -x  # takes away that of the logarithm too

    joint.to_between = lost


def break_noise() -> None:
    """Let the correlated noise start anew at each block mean."""
    from qlvbayes.inference.errors import whitening

    whole = whitening.averaged_correlation
    whitening.averaged_correlation = lambda *some: np.diag(np.diag(whole(*some)))


BROKEN = {"jacobian": break_jacobian, "noise": break_noise}


@cache
def break_once(what: str) -> None:
    """Make one of these mistakes, unless it is made already."""
    BROKEN[what]()


def p_of_uniform(ranks: Sequence[int]) -> float:
    """P-value of Neyman's smooth test of order 2 that ranks from 0 to 99 are uniform.

    Two sums over u = (rank + 1/2)/100, of sqrt(3) (2u - 1) for a bias and sqrt(5) (6u^2 - 6u + 1)
    for a spread that is too narrow or too wide; their squares over n are chi-square of two degrees
    of freedom (Neyman 1937, Skand. Aktuarietidskr. 20, 149). It sees either better than a
    chi-square test of ten bins.
    """
    u = (np.asarray(ranks) + 0.5) / (DRAWS + 1)
    bias, spread = np.sqrt(3.0) * (2.0 * u - 1.0), np.sqrt(5.0) * (6.0 * u**2 - 6.0 * u + 1.0)
    return float(chi2.sf((bias.sum() ** 2 + spread.sum() ** 2) / u.size, 2))


def columns(fits: Sequence[dict]) -> dict[str, list[int]]:
    """Ranks of all fits by constant."""
    return {name: [fit["ranks"][name] for fit in fits] for name in fits[0]["ranks"]}


def p_of_no_bias(fits: Sequence[dict]) -> float:
    """P-value of Hotelling's test that no constant's ranks are biased, all constants together.

    A mistake moves several constants a little, which no single one need show.
    """
    ranks = np.array(list(columns(fits).values()), dtype=float).T
    count, size = ranks.shape
    if count <= size:
        return 1.0
    shift = ranks.mean(axis=0) - 0.5 * DRAWS
    squared = count * shift @ np.linalg.pinv(np.atleast_2d(np.cov(ranks.T))) @ shift
    return float(f.sf(squared * (count - size) / (size * (count - 1)), size, count - size))


def passes(fits: Sequence[dict]) -> bool:
    """Return whether ranks are uniform at 1 %: each constant's own, and all without a bias.

    The level is divided among the tests (Bonferroni).
    """
    ps = [p_of_uniform(ranks) for ranks in columns(fits).values()]
    return 2.0 * min(min(ps) * len(ps), p_of_no_bias(fits)) >= LEVEL


def band(count: int, share: float) -> tuple[float, float]:
    """The shares between which 99 of 100 binomial shares of so many fits lie."""
    low, high = binom.interval(0.99, count, share) if count else (0.0, 0.0)
    return float(low) / max(count, 1), float(high) / max(count, 1)


def inside(ranks: Sequence[int], share: float) -> float:
    """Share of the truths in the central interval that holds this share of the ranks."""
    tail = (1.0 - share) / 2.0 * (DRAWS + 1)
    return float(np.mean([tail <= rank < DRAWS + 1 - tail for rank in ranks]))


COLUMNS = (
    "series", "pads", "ranks are", "p of no bias in all together", "least p of a constant",
    "in 90 % (lowest and highest constant)",
)  # fmt: skip


def row(kind: Kind, fits: Sequence[dict]) -> list[str]:
    """Return the row of one series."""
    ranks = columns(fits)
    least, name = min((p_of_uniform(some), name) for name, some in ranks.items())
    shares = sorted(inside(some, 0.9) for some in ranks.values())
    return [
        _TITLES[kind.broken], str(len(fits)),
        "uniform" if passes(fits) else "**not uniform**", f"{p_of_no_bias(fits):.2g}",
        f"{least:.2g} ({name})", f"{shares[0]:.0%} to {shares[-1]:.0%}",
    ]  # fmt: skip


_TITLES = {
    "": "as it is",
    "jacobian": "log-Jacobians left out on purpose",
    "noise": "noise forgotten between block means on purpose",
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--fits", type=int, default=200, help="pads of each series")
    parser.add_argument("--broken-fits", type=int, default=100, help="of those with a mistake")
    parser.add_argument("--seed", type=int, default=1, help="decides all pads")
    parser.add_argument("--jobs", type=int, default=JOBS, help="two or more: mistakes stay in them")
    options = parser.parse_args()
    origin, rows = Origin.now(), []
    for kind in map(Kind, ("", *BROKEN)):
        count = options.broken_fits if kind.broken else options.fits
        name, study = f"{kind.name}-seed{options.seed}", partial(run, kind, options.seed)
        rows.append(row(kind, finished(name, study, range(count), max(options.jobs, 2))))
    low, high = band(options.fits, 0.9)
    note = f"Of {options.fits} pads, 99 of 100 such shares lie between {low:.0%} and {high:.0%}."
    Table(origin, options.fits, COLUMNS, rows, [note]).write("ranks")


if __name__ == "__main__":
    main()
