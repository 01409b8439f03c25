"""Sample a posterior with emcee, store the chain on disk, and stop when it suffices.

One call evaluates all walkers that move, in `coordinates` that straighten the posterior;
what is kept is theta. Two kinds of moves alternate at random: independence
proposals shaped like the posterior (see ``proposal``), and differential evolution between walkers
(ter Braak 2006, doi:10.1007/s11222-006-8769-1), which needs no knowledge of the posterior. Each
leaves the posterior invariant on its own. The proposals are adapted to the chain a few times, and
the steps before the last adaptation are discarded.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, field

import emcee
import numpy as np

from qlvbayes.fitting.chainstore import ChainSegment, ChainStore
from qlvbayes.fitting.coordinates import Coordinates
from qlvbayes.fitting.diagnostics import diagnose_chain
from qlvbayes.fitting.least_squares import NormalApproximation
from qlvbayes.fitting.posterior import Posterior
from qlvbayes.fitting.proposal import Proposal, from_draws, from_normal

Progress = Callable[[int, int], None]

STEPS_PER_TIME = 50  # autocorrelation times a chain must last (emcee's own advice)
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


@dataclass
class _ChainProgress:
    """The segments of a chain that have been sampled so far."""

    segments: list[ChainSegment] = field(default_factory=list)

    @property
    def steps(self) -> int:
        """Return the number of steps."""
        return sum(len(segment.theta) for segment in self.segments)

    @property
    def adapted(self) -> int:
        """Return the number of segments before the last adaptation."""
        return max((n for n in _ADAPT_AFTER if n <= len(self.segments)), default=0)

    @property
    def kept(self) -> int:
        """Return the number of steps since the last adaptation."""
        return sum(len(segment.theta) for segment in self.segments[self.adapted :])

    def is_check_due(self, first: int) -> bool:
        """Return whether to check convergence, at ``first`` kept steps, then 1.25 times as many."""
        kept, next_check, due = 0, first, False
        for segment in self.segments[self.adapted :]:
            kept += len(segment.theta)
            due = kept >= next_check
            next_check = int(_PATIENCE * kept) if due else next_check
        return due

    def proposals(
        self, start: NormalApproximation, coordinates: Coordinates
    ) -> tuple[Proposal, ...]:
        """Return one kernel about the optimum; after an adaptation, one and many from the chain."""
        if not self.adapted:
            return (from_normal(start),)
        # the later half of what was sampled with the proposal before
        recent = self.segments[self.adapted // 2 : self.adapted]
        theta = np.concatenate([segment.theta for segment in recent])
        draws = coordinates.from_theta(theta[len(theta) // 2 :].reshape(-1, theta.shape[-1]))
        covariance = np.atleast_2d(np.cov(draws, rowvar=False))
        overall = NormalApproximation(draws.mean(axis=0), covariance)
        return from_normal(overall), from_draws(draws)

    def chain(self) -> Chain:
        """Return the chain of all steps since the last adaptation, without burn-in."""
        kept = self.segments[self.adapted :] or self.segments[-1:]
        theta = np.concatenate([segment.theta for segment in kept])
        density = np.concatenate([segment.log_density for segment in kept])
        burn = int(_BURN_IN * len(theta))
        accepted = sum(segment.accepted for segment in kept) / density.size
        return Chain.judged(theta[burn:], density[burn:], accepted, self.steps)


def sample(
    posterior: Posterior,
    start: NormalApproximation,
    settings: Settings,
    store: ChainStore | None = None,
    progress: Progress | None = None,
) -> Chain:
    """Return a chain that has lasted 50 autocorrelation times and mixed, or ``max_steps``."""
    walkers = max(settings.walkers, 2 * posterior.size + 2)
    so_far = _ChainProgress(list(store.load()) if store else [])
    coordinates = Coordinates.from_posterior(posterior, start)
    start = coordinates.of_normal(start)
    sampler = _sampler(coordinates, so_far.proposals(start, coordinates), walkers)
    state = _state(so_far, sampler, start, coordinates, walkers, settings.seed)
    expected = settings.min_steps
    while so_far.steps < settings.max_steps:
        if so_far.is_check_due(settings.min_steps):
            chain = so_far.chain()
            if chain.enough:
                return chain
            expected = _expected(chain, so_far, settings)
        if progress:
            progress(so_far.steps, expected)
        count = min(settings.stretch, settings.max_steps - so_far.steps)
        state, segment = _advance(sampler, state, coordinates, count)
        if store:
            store.save(len(so_far.segments), segment)
        so_far.segments.append(segment)
        if len(so_far.segments) in _ADAPT_AFTER:
            sampler = _sampler(coordinates, so_far.proposals(start, coordinates), walkers)
    return so_far.chain()


def _expected(chain: Chain, so_far: _ChainProgress, settings: Settings) -> int:
    """Return the number of steps that will probably be needed."""
    wanted = STEPS_PER_TIME * chain.autocorrelation / (1.0 - _BURN_IN)
    return int(
        min(so_far.steps - so_far.kept + max(wanted, settings.min_steps), settings.max_steps)
    )


def autocorrelation_time(theta: np.ndarray) -> float:
    """Return the longest integrated autocorrelation time (steps) in theta (S, W, D)."""
    if theta.shape[-1] == 0 or np.any(np.ptp(theta, axis=0) == 0.0):
        return float("inf")
    return float(np.max(emcee.autocorr.integrated_time(theta, tol=0, quiet=True)))


def _sampler(
    coordinates: Coordinates, proposals: tuple[Proposal, ...], walkers: int
) -> emcee.EnsembleSampler:
    """Return emcee's sampler with its moves."""
    posterior = coordinates.posterior
    size = posterior.size

    def log_density(points: np.ndarray) -> np.ndarray:
        return posterior.log_density(coordinates.to_theta(points))

    independent = [(emcee.moves.MHMove(p.move), _INDEPENDENT / len(proposals)) for p in proposals]
    moves = [*independent, *_differential(size)]
    return emcee.EnsembleSampler(walkers, size, log_density, moves=moves, vectorize=True)


def _differential(size: int) -> list[tuple[emcee.moves.DEMove, float]]:
    """Return differential evolution with its optimal stride, and with a short one."""
    optimal = 2.38 / np.sqrt(2.0 * size)
    share = (1.0 - _INDEPENDENT) / 2.0
    return [(emcee.moves.DEMove(gamma0=stride), share) for stride in (optimal, 0.3 * optimal)]


def _state(
    so_far: _ChainProgress,
    sampler: emcee.EnsembleSampler,
    start: NormalApproximation,
    coordinates: Coordinates,
    walkers: int,
    seed: int,
) -> emcee.State:
    """Return the state from which sampling goes on."""
    if so_far.segments:
        last = so_far.segments[-1]
        return _state_after(last, coordinates)
    points = _inside(coordinates, start.draw(walkers, np.random.default_rng(seed)))
    random_state = np.random.RandomState(seed).get_state()
    return emcee.State(
        points, log_prob=sampler.compute_log_prob(points)[0], random_state=random_state
    )


def _inside(coordinates: Coordinates, points: np.ndarray) -> np.ndarray:
    """Return points (W, D) that lie beyond a bound of theta reflected at it."""
    own, theta = coordinates.posterior.parameters, coordinates.to_theta(points)
    reflected = np.where(theta < own.lowest, 2.0 * own.lowest - theta, theta)
    reflected = np.where(theta > own.highest, 2.0 * own.highest - theta, reflected)
    outside = np.any(reflected != theta, axis=1)[:, None]
    return np.where(outside, coordinates.from_theta(own.within(reflected)), points)


def _state_after(segment: ChainSegment, coordinates: Coordinates) -> emcee.State:
    """Return the state at the end of a segment, the same whether it was sampled now or loaded."""
    return emcee.State(
        coordinates.from_theta(segment.theta[-1]),
        log_prob=segment.log_density[-1],
        random_state=segment.random_state,
    )


def _advance(
    sampler: emcee.EnsembleSampler, state: emcee.State, coordinates: Coordinates, count: int
) -> tuple[emcee.State, ChainSegment]:
    """Return the state after ``count`` more steps, and these as a segment."""
    sampler.reset()
    state = sampler.run_mcmc(state, count, skip_initial_state_check=True)
    accepted = int(np.sum(sampler.backend.accepted))
    theta = coordinates.to_theta(sampler.get_chain())
    segment = ChainSegment(theta, sampler.get_log_prob(), accepted, state.random_state)
    return _state_after(segment, coordinates), segment


def key_of(posterior: Posterior, settings: Settings, method: str = "emcee") -> str:
    """Return a digest of everything that a chain depends on."""
    text = repr((posterior.digest, settings, method))
    return hashlib.sha256(text.encode()).hexdigest()
