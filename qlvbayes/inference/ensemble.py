"""emcee over a posterior: one compiled call for all walkers, kept on disk, run until it is enough.

Two moves alternate at random: an independence proposal from the Student-t that widens Laplace's
approximation (near-independent draws where the posterior is close to normal), and differential
evolution between walkers (ter Braak 2006, doi:10.1007/s11222-006-8769-1), which needs no such
luck. Each leaves the posterior invariant on its own.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, field

import emcee
import jax
import numpy as np
from scipy.stats import multivariate_t

from qlvbayes.inference import compiled
from qlvbayes.inference.chainstore import ChainStore, Stretch
from qlvbayes.inference.normal import NormalApproximation
from qlvbayes.posterior import Posterior

Progress = Callable[[int, int], None]

STEPS_PER_TIME = 50  # autocorrelation times a chain must last (emcee's own advice)
_BURN_IN = 0.2  # share of the chain left out at its beginning
_TAIL = 5.0  # degrees of freedom of the independence proposal


@dataclass(frozen=True)
class Settings:
    """How long to sample: ``max_steps`` at most, looking every ``stretch`` steps."""

    walkers: int = 32
    min_steps: int = 600
    max_steps: int = 20_000
    stretch: int = 200
    seed: int = 0


@dataclass(frozen=True)
class Chain:
    """theta (S, W, D) and log density (S, W) after burn-in, and how well they mixed.

    autocorrelation: the longest autocorrelation time (steps) over the D numbers; enough: whether
    the chain lasts 50 of them.
    """

    theta: np.ndarray
    log_density: np.ndarray
    autocorrelation: float
    acceptance: float
    steps: int
    enough: bool


@dataclass
class _Run:
    """What has been sampled so far."""

    stretches: list[Stretch] = field(default_factory=list)

    @property
    def steps(self) -> int:
        return sum(len(stretch.theta) for stretch in self.stretches)

    def chain(self, walkers: int) -> Chain:
        theta = np.concatenate([stretch.theta for stretch in self.stretches])
        density = np.concatenate([stretch.log_density for stretch in self.stretches])
        burn = int(_BURN_IN * len(theta))
        theta, density = theta[burn:], density[burn:]
        time = autocorrelation_time(theta)
        accepted = sum(stretch.accepted for stretch in self.stretches) / (walkers * self.steps)
        enough = bool(len(theta) >= STEPS_PER_TIME * time)
        return Chain(theta, density, time, accepted, self.steps, enough)


def sample(
    posterior: Posterior,
    start: NormalApproximation,
    settings: Settings,
    store: ChainStore | None = None,
    progress: Progress | None = None,
) -> Chain:
    """Sample until the chain lasts 50 autocorrelation times, or ``max_steps``.

    ``store`` keeps each stretch on disk and is where an interrupted run resumes: the resumed chain
    is the one that the uninterrupted run would have had.
    """
    walkers = max(settings.walkers, 2 * posterior.size + 2)
    run = _Run(list(store.load()) if store else [])
    sampler = _sampler(posterior, start, walkers)
    state = _state(run, sampler, start, walkers, settings.seed)
    while True:
        chain = run.chain(walkers) if run.steps else None
        if chain and (run.steps >= settings.max_steps or _done(chain, settings)):
            return chain
        if progress:
            progress(run.steps, _expected(chain, settings))
        count = min(settings.stretch, settings.max_steps - run.steps)
        state, stretch = _advance(sampler, state, count)
        if store:
            store.save(len(run.stretches), stretch)
        run.stretches.append(stretch)


def _done(chain: Chain, settings: Settings) -> bool:
    return chain.enough and chain.steps >= settings.min_steps


def _expected(chain: Chain | None, settings: Settings) -> int:
    """Steps that will probably be needed."""
    if chain is None:
        return settings.min_steps
    wanted = STEPS_PER_TIME * chain.autocorrelation / (1.0 - _BURN_IN)
    return int(min(max(wanted, settings.min_steps), settings.max_steps))


def autocorrelation_time(theta: np.ndarray) -> float:
    """Longest integrated autocorrelation time (steps) over the numbers of theta (S, W, D)."""
    spread = theta.std(axis=(0, 1))
    if theta.shape[-1] == 0 or np.any(spread == 0.0):
        return float("inf")
    return float(np.max(emcee.autocorr.integrated_time(theta, tol=0, quiet=True)))


def _sampler(
    posterior: Posterior, start: NormalApproximation, walkers: int
) -> emcee.EnsembleSampler:
    size = posterior.size

    def log_density(thetas: np.ndarray) -> np.ndarray:
        # a move asks for all walkers or for half of them: one compiled size serves both
        full = np.zeros((walkers, size))
        full[: len(thetas)] = thetas
        return np.asarray(compiled.log_densities(posterior, full))[: len(thetas)]

    moves = [(emcee.moves.MHMove(_independence(start)), 0.5), (emcee.moves.DEMove(), 0.5)]
    return emcee.EnsembleSampler(walkers, size, log_density, moves=moves, vectorize=True)


def _independence(
    start: NormalApproximation,
) -> Callable[[np.ndarray, np.random.RandomState], tuple[np.ndarray, np.ndarray]]:
    """Proposals that do not depend on where the walker is, with their density ratio."""
    proposal = multivariate_t(start.mean, start.covariance, df=_TAIL)
    root = np.linalg.cholesky(start.covariance)

    def propose(
        coords: np.ndarray, random: np.random.RandomState
    ) -> tuple[np.ndarray, np.ndarray]:
        normal = random.standard_normal(coords.shape) @ root.T
        stretch = np.sqrt(_TAIL / random.chisquare(_TAIL, size=(len(coords), 1)))
        new = start.mean + stretch * normal
        return new, proposal.logpdf(coords) - proposal.logpdf(new)

    return propose


def _state(
    run: _Run,
    sampler: emcee.EnsembleSampler,
    start: NormalApproximation,
    walkers: int,
    seed: int,
) -> emcee.State:
    if run.stretches:
        last = run.stretches[-1]
        return emcee.State(
            last.theta[-1], log_prob=last.log_density[-1], random_state=last.random_state
        )
    thetas = start.draw(walkers, np.random.default_rng(seed))
    random_state = np.random.RandomState(seed).get_state()
    return emcee.State(thetas, log_prob=sampler.compute_log_prob(thetas)[0],
                       random_state=random_state)  # fmt: skip


def _advance(
    sampler: emcee.EnsembleSampler, state: emcee.State, count: int
) -> tuple[emcee.State, Stretch]:
    sampler.reset()
    state = sampler.run_mcmc(state, count, skip_initial_state_check=True)
    accepted = int(np.sum(sampler.backend.accepted))
    stretch = Stretch(sampler.get_chain(), sampler.get_log_prob(), accepted, state.random_state)
    return state, stretch


def key_of(posterior: Posterior, start: NormalApproximation, settings: Settings) -> str:
    """Digest of everything that a chain depends on."""
    leaves, shape = jax.tree.flatten(posterior)
    digest = hashlib.sha256(repr((str(shape), settings)).encode())
    for leaf in leaves:
        digest.update(np.ascontiguousarray(leaf).tobytes())
    return digest.hexdigest()
