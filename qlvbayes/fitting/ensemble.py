"""Sample a posterior with emcee, store the chain on disk, and stop when it suffices.

One call evaluates all walkers that move, in `coordinates` that straighten the posterior; what is
kept is theta. Two kinds of moves alternate at random: independence proposals shaped like the
posterior (`coordinates.Proposal`), and differential evolution between walkers (ter Braak 2006,
doi:10.1007/s11222-006-8769-1), which needs no knowledge of the posterior. Each leaves the posterior
invariant on its own. The proposals are adapted to the chain a few times, and the steps before the
last adaptation are discarded.
"""

from __future__ import annotations

import hashlib
import io
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import emcee
import numpy as np
from arviz_stats.base import array_stats

from qlvbayes.fitting.coordinates import Coordinates, KernelProposal, from_draws, from_normal
from qlvbayes.fitting.least_squares import NormalApproximation
from qlvbayes.fitting.posterior import Posterior
from qlvbayes.io.files import write_whole

Progress = Callable[[int, int], None]

STEPS_PER_TIME = 50  # autocorrelation times a chain must last (emcee's own advice)
LARGEST_R_HAT = 1.05
FEWEST_EFFECTIVE = 400
_BURN_IN = 0.1  # share of the chain since the last adaptation that is discarded at its beginning
_ADAPT_AFTER = (1, 2, 10, 30)  # segments after which the independence proposals are adapted
_INDEPENDENT = 0.5  # share of independence proposals among the moves
_PATIENCE = 1.25  # growth of the chain between convergence checks


@dataclass(frozen=True)
class Settings:
    """The settings of the sampler: numbers of walkers and steps, and the seed.

    walkers: Number of walkers; twice the number of parameters and 2 more at least; min_steps,
    max_steps: At least ``min_steps`` are kept, and at most ``max_steps`` are sampled in all;
    stretch: Steps in one stored segment of the chain; seed: Seed of the chain.
    """

    walkers: int = 32
    min_steps: int = 600
    max_steps: int = 100_000
    stretch: int = 200
    seed: int = 0


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
    r_hat, ess = np.full((2, chains.shape[-1]), np.nan)
    for k in np.flatnonzero(np.ptp(chains, axis=(0, 1)) > 0.0):
        values = np.ascontiguousarray(chains[..., k])
        r_hat[k] = array_stats.rhat(values, chain_axis=0, draw_axis=1)
        ess[k] = array_stats.ess(values, chain_axis=0, draw_axis=1, method="bulk")
    return Diagnostics(r_hat, ess)


def highest_density(values: np.ndarray, share: float = 0.9) -> tuple[float, float]:
    """Return the ends of the shortest interval that holds ``share`` of the draws (any shape)."""
    flat = np.sort(np.ravel(values))
    inside = int(np.floor(share * flat.size))
    start = int(np.argmin(flat[inside:] - flat[: flat.size - inside]))
    return float(flat[start]), float(flat[start + inside])


def autocorrelation_time(theta: np.ndarray) -> float:
    """Return the longest integrated autocorrelation time (steps) in theta (S, W, D)."""
    if theta.shape[-1] == 0 or np.any(np.ptp(theta, axis=0) == 0.0):
        return float("inf")
    return float(np.max(emcee.autocorr.integrated_time(theta, tol=0, quiet=True)))


@dataclass(frozen=True)
class Chain:
    """The steps of a chain after burn-in, and how well they mixed.

    theta (S, W, D) and log density (S, W): of S steps of W walkers; autocorrelation: the longest
    autocorrelation time (steps) of the D parameters; acceptance: share of accepted moves; steps:
    number sampled in all; enough: whether the chain lasts 50 autocorrelation times, with R-hat and
    effective sample size in agreement.
    """

    theta: np.ndarray
    log_density: np.ndarray
    autocorrelation: float
    acceptance: float
    steps: int
    enough: bool

    @classmethod
    def judged(
        cls, theta: np.ndarray, log_density: np.ndarray, acceptance: float, steps: int
    ) -> Chain:
        """Return the chain with its autocorrelation time, and whether it suffices."""
        time = autocorrelation_time(theta)
        mixed = not diagnose_chain(np.swapaxes(theta, 0, 1)).troubles
        enough = mixed and bool(len(theta) >= STEPS_PER_TIME * time)
        return cls(theta, log_density, time, acceptance, steps, enough)


@dataclass(frozen=True)
class ChainSegment:
    """Consecutive steps of a chain, with the state of the random generator after them."""

    # theta (S, W, D) and log_density (S, W): of S steps of W walkers
    theta: np.ndarray
    log_density: np.ndarray
    accepted: int  # number of accepted moves
    random_state: tuple


@dataclass(frozen=True)
class ChainStore:
    """The segments of a chain as numbered files in one folder.

    key: identifies the posterior and the seed that the chain belongs to.
    """

    folder: Path
    key: str

    def load(self) -> Iterator[ChainSegment]:
        """Yield the stored segments in order, as far as they are whole and belong to this run."""
        for number in range(10**6):
            try:
                with np.load(io.BytesIO(self._path(number).read_bytes())) as file:
                    if str(file["key"]) != self.key:
                        return
                    position, half, normal = file["place"]
                    state = "MT19937", file["state"], int(position), int(half), float(normal)
                    content = file["theta"], file["log_density"], int(file["accepted"])
            except (OSError, EOFError, ValueError, KeyError, zipfile.BadZipFile):
                return
            yield ChainSegment(*content, state)

    def save(self, number: int, segment: ChainSegment) -> None:
        """Write segment ``number``, completely or not at all."""
        self.folder.mkdir(parents=True, exist_ok=True)
        _, state, *position = segment.random_state
        content = io.BytesIO()
        np.savez(
            content, key=self.key, theta=segment.theta, log_density=segment.log_density,
            accepted=segment.accepted, state=state, place=np.array(position, dtype=float),
        )  # fmt: skip
        write_whole(self._path(number), content.getbuffer())

    def _path(self, number: int) -> Path:
        return self.folder / f"stretch-{number:05d}.npz"


def remove_chain(folder: Path) -> None:
    """Remove a chain's folder; called once the results are written."""
    if folder.is_dir():
        for path in folder.glob("stretch-*"):
            path.unlink()
        folder.rmdir()


def key_of(posterior: Posterior, settings: Settings, method: str = "emcee") -> str:
    """Return a digest of everything that a chain depends on."""
    text = repr((posterior.digest, settings, method))
    return hashlib.sha256(text.encode()).hexdigest()


def sample(
    posterior: Posterior,
    start: NormalApproximation,
    settings: Settings,
    store: ChainStore | None = None,
    progress: Progress | None = None,
) -> Chain:
    """Return a chain that has lasted 50 autocorrelation times and mixed, or ``max_steps``."""
    walkers = max(settings.walkers, 2 * posterior.size + 2)
    coordinates = Coordinates.from_posterior(posterior, start)
    start = coordinates.of_normal(start)
    so_far = _ChainProgress(list(store.load()) if store else [], start, coordinates)
    sampler = so_far.sampler(walkers)
    if so_far.segments:
        state = so_far.state
    else:
        points = _inside(coordinates, start.draw(walkers, np.random.default_rng(settings.seed)))
        random = np.random.RandomState(settings.seed).get_state()
        density = sampler.compute_log_prob(points)[0]
        state = emcee.State(points, log_prob=density, random_state=random)
    expected = settings.min_steps
    while so_far.steps < settings.max_steps:
        if so_far.is_check_due(settings.min_steps):
            chain = so_far.chain()
            if chain.enough:
                return chain
            wanted = STEPS_PER_TIME * chain.autocorrelation / (1.0 - _BURN_IN)
            discarded = so_far.steps - sum(len(one.theta) for one in so_far.kept)
            likely = discarded + max(wanted, settings.min_steps)
            expected = int(min(likely, settings.max_steps))
        if progress:
            progress(so_far.steps, expected)
        count = min(settings.stretch, settings.max_steps - so_far.steps)
        sampler.reset()
        after = sampler.run_mcmc(state, count, skip_initial_state_check=True)
        theta, accepted = coordinates.to_theta(sampler.get_chain()), sampler.backend.accepted.sum()
        segment = ChainSegment(theta, sampler.get_log_prob(), int(accepted), after.random_state)
        if store:
            store.save(len(so_far.segments), segment)
        so_far.segments.append(segment)
        state = so_far.state
        if len(so_far.segments) in _ADAPT_AFTER:
            sampler = so_far.sampler(walkers)
    return so_far.chain()


def _inside(coordinates: Coordinates, points: np.ndarray) -> np.ndarray:
    """Return points (W, D) that lie beyond a bound of theta reflected at it."""
    own, theta = coordinates.posterior.parameters, coordinates.to_theta(points)
    reflected = np.where(theta < own.lowest, 2.0 * own.lowest - theta, theta)
    reflected = np.where(theta > own.highest, 2.0 * own.highest - theta, reflected)
    outside = np.any(reflected != theta, axis=1)[:, None]
    return np.where(outside, coordinates.from_theta(own.within(reflected)), points)


@dataclass(frozen=True)
class _ChainProgress:
    """The segments of a chain that have been sampled so far, about ``start``, in coordinates."""

    segments: list[ChainSegment]
    start: NormalApproximation
    coordinates: Coordinates

    @property
    def steps(self) -> int:
        return sum(len(segment.theta) for segment in self.segments)

    @property
    def adapted(self) -> int:
        """Number of segments before the last adaptation."""
        return max((n for n in _ADAPT_AFTER if n <= len(self.segments)), default=0)

    @property
    def kept(self) -> list[ChainSegment]:
        return self.segments[self.adapted :]

    @property
    def state(self) -> emcee.State:
        """State after the last segment, the same whether it was sampled now or loaded."""
        last = self.segments[-1]
        points = self.coordinates.from_theta(last.theta[-1])
        return emcee.State(points, log_prob=last.log_density[-1], random_state=last.random_state)

    def is_check_due(self, first: int) -> bool:
        """Return whether to check convergence, at ``first`` kept steps, then 1.25 times as many."""
        kept, next_check, due = 0, first, False
        for segment in self.kept:
            kept += len(segment.theta)
            due = kept >= next_check
            next_check = int(_PATIENCE * kept) if due else next_check
        return due

    def sampler(self, walkers: int) -> emcee.EnsembleSampler:
        """Return emcee's sampler: proposals, and differential evolution by long and short steps."""
        coordinates, proposals = self.coordinates, self._proposals
        posterior = coordinates.posterior
        share, stride = 0.5 * (1.0 - _INDEPENDENT), 2.38 / np.sqrt(2.0 * posterior.size)
        moves = [
            *((emcee.moves.MHMove(p.move), _INDEPENDENT / len(proposals)) for p in proposals),
            *((emcee.moves.DEMove(gamma0=gamma), share) for gamma in (stride, 0.3 * stride)),
        ]

        def log_density(points: np.ndarray) -> np.ndarray:
            return posterior.log_density(coordinates.to_theta(points))

        return emcee.EnsembleSampler(
            walkers, posterior.size, log_density, moves=moves, vectorize=True
        )

    @property
    def _proposals(self) -> tuple[KernelProposal, ...]:
        """One kernel about the optimum; after an adaptation, one and many from the chain."""
        if not self.adapted:
            return (from_normal(self.start),)
        # the later half of what was sampled with the proposal before
        recent = self.segments[self.adapted // 2 : self.adapted]
        theta = np.concatenate([segment.theta for segment in recent])
        some = theta[len(theta) // 2 :].reshape(-1, theta.shape[-1])
        draws = self.coordinates.from_theta(some)
        covariance = np.atleast_2d(np.cov(draws, rowvar=False))
        overall = NormalApproximation(draws.mean(axis=0), covariance)
        return from_normal(overall), from_draws(draws)

    def chain(self) -> Chain:
        """Return the chain of all steps since the last adaptation, without burn-in."""
        kept = self.kept or self.segments[-1:]
        theta = np.concatenate([segment.theta for segment in kept])
        density = np.concatenate([segment.log_density for segment in kept])
        burn = int(_BURN_IN * len(theta))
        accepted = sum(segment.accepted for segment in kept) / density.size
        return Chain.judged(theta[burn:], density[burn:], accepted, self.steps)
