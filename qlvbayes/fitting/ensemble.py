"""emcee over a posterior: one compiled call for all walkers, kept on disk, run until it is enough.

Moves alternate at random: independence proposals shaped like the posterior (see ``proposal``), and
differential evolution between walkers (ter Braak 2006, doi:10.1007/s11222-006-8769-1), which needs
no such knowledge. Each leaves the posterior invariant on its own. The proposals are made anew from
the chain a few times; what was sampled before the last time is left out.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, field

import emcee
import jax
import numpy as np

from qlvbayes.fitting import compiled
from qlvbayes.fitting.chainstore import ChainStore, Stretch
from qlvbayes.fitting.diagnostics import diagnose_chain
from qlvbayes.fitting.least_squares import NormalApproximation
from qlvbayes.fitting.proposal import Proposal, from_draws, from_normal
from qlvbayes.model.posterior import Posterior

Progress = Callable[[int, int], None]

STEPS_PER_TIME = 50  # autocorrelation times a chain must last (emcee's own advice)
_BURN_IN = 0.1  # share of the chain since the last adaptation left out at its beginning
_ADAPT_AFTER = (1, 2, 10, 30)  # stretches after which the independence proposal is made anew
_INDEPENDENT = 0.5  # share of independence proposals among the moves
_PATIENCE = 1.25  # growth of the chain between looks at its autocorrelation


@dataclass(frozen=True)
class Settings:
    """How long to sample: at least ``min_steps`` that are kept, at most ``max_steps`` in all."""

    walkers: int = 32
    min_steps: int = 600
    max_steps: int = 100_000
    stretch: int = 200
    seed: int = 0


@dataclass(frozen=True)
class Chain:
    """theta (S, W, D) and log density (S, W) after burn-in, and how well they mixed.

    autocorrelation: the longest autocorrelation time (steps) over the D numbers; enough: whether
    the chain lasts 50 of them, and R-hat and effective sample size agree.
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
        """The chain with its autocorrelation time, and whether that is enough."""
        time = autocorrelation_time(theta)
        mixed = not diagnose_chain(np.swapaxes(theta, 0, 1)).troubles
        enough = mixed and bool(len(theta) >= STEPS_PER_TIME * time)
        return cls(theta, log_density, time, acceptance, steps, enough)


@dataclass
class _Run:
    """What has been sampled so far."""

    stretches: list[Stretch] = field(default_factory=list)

    @property
    def steps(self) -> int:
        return sum(len(stretch.theta) for stretch in self.stretches)

    @property
    def adapted(self) -> int:
        """Stretches before the last adaptation."""
        return max((n for n in _ADAPT_AFTER if n <= len(self.stretches)), default=0)

    @property
    def kept(self) -> int:
        """Steps since the last adaptation."""
        return sum(len(stretch.theta) for stretch in self.stretches[self.adapted :])

    def due(self, first: int) -> bool:
        """Whether to look at the chain: with ``first`` steps kept, then 1.25 times as many, ...

        It depends on nothing but the stretches, so that a resumed run looks where it would have.
        """
        kept, look_at, due = 0, first, False
        for stretch in self.stretches[self.adapted :]:
            kept += len(stretch.theta)
            due = kept >= look_at
            look_at = int(_PATIENCE * kept) if due else look_at
        return due

    def proposals(self, start: NormalApproximation) -> tuple[Proposal, ...]:
        """One kernel from the optimum; later one, and many, from the chain."""
        if not self.adapted:
            return (from_normal(start),)
        # the later half of what was sampled with the proposal before
        recent = self.stretches[self.adapted // 2 : self.adapted]
        theta = np.concatenate([stretch.theta for stretch in recent])
        draws = theta[len(theta) // 2 :].reshape(-1, theta.shape[-1])
        covariance = np.atleast_2d(np.cov(draws, rowvar=False))
        overall = NormalApproximation(draws.mean(axis=0), covariance)
        return from_normal(overall), from_draws(draws)

    def chain(self) -> Chain:
        kept = self.stretches[self.adapted :] or self.stretches[-1:]
        theta = np.concatenate([stretch.theta for stretch in kept])
        density = np.concatenate([stretch.log_density for stretch in kept])
        burn = int(_BURN_IN * len(theta))
        accepted = sum(stretch.accepted for stretch in kept) / density.size
        return Chain.judged(theta[burn:], density[burn:], accepted, self.steps)


def sample(
    posterior: Posterior,
    start: NormalApproximation,
    settings: Settings,
    store: ChainStore | None = None,
    progress: Progress | None = None,
) -> Chain:
    """Sample until the chain has lasted 50 autocorrelation times and mixed, or ``max_steps``.

    ``store`` keeps each stretch on disk and is where an interrupted run resumes: the resumed chain
    is the one that the uninterrupted run would have had.
    """
    walkers = max(settings.walkers, 2 * posterior.size + 2)
    run = _Run(list(store.load()) if store else [])
    sampler = _sampler(posterior, run.proposals(start), walkers)
    state = _state(run, sampler, start, walkers, settings.seed)
    expected = settings.min_steps
    while run.steps < settings.max_steps:
        if run.due(settings.min_steps):
            chain = run.chain()
            if chain.enough:
                return chain
            expected = _expected(chain, run, settings)
        if progress:
            progress(run.steps, expected)
        count = min(settings.stretch, settings.max_steps - run.steps)
        state, stretch = _advance(sampler, state, count)
        if store:
            store.save(len(run.stretches), stretch)
        run.stretches.append(stretch)
        if len(run.stretches) in _ADAPT_AFTER:
            sampler = _sampler(posterior, run.proposals(start), walkers)
    return run.chain()


def _expected(chain: Chain, run: _Run, settings: Settings) -> int:
    """Steps that will probably be needed."""
    wanted = STEPS_PER_TIME * chain.autocorrelation / (1.0 - _BURN_IN)
    return int(min(run.steps - run.kept + max(wanted, settings.min_steps), settings.max_steps))


def autocorrelation_time(theta: np.ndarray) -> float:
    """Longest integrated autocorrelation time (steps) over the numbers of theta (S, W, D)."""
    spread = theta.std(axis=(0, 1))
    if theta.shape[-1] == 0 or np.any(spread == 0.0):
        return float("inf")
    return float(np.max(emcee.autocorr.integrated_time(theta, tol=0, quiet=True)))


def _sampler(
    posterior: Posterior, proposals: tuple[Proposal, ...], walkers: int
) -> emcee.EnsembleSampler:
    size = posterior.size

    def log_density(thetas: np.ndarray) -> np.ndarray:
        # a move asks for all walkers or for half of them: one compiled size serves both
        full = np.zeros((walkers, size))
        full[: len(thetas)] = thetas
        return np.asarray(compiled.log_densities(posterior, full))[: len(thetas)]

    independent = [(emcee.moves.MHMove(p.move), _INDEPENDENT / len(proposals)) for p in proposals]
    moves = [*independent, *_differential(size)]
    return emcee.EnsembleSampler(walkers, size, log_density, moves=moves, vectorize=True)


def _differential(size: int) -> list[tuple[emcee.moves.DEMove, float]]:
    """Differential evolution with its usual stride, and with a short one for narrow places."""
    usual = 2.38 / np.sqrt(2.0 * size)
    share = (1.0 - _INDEPENDENT) / 2.0
    return [(emcee.moves.DEMove(gamma0=stride), share) for stride in (usual, 0.3 * usual)]


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
    return emcee.State(
        thetas, log_prob=sampler.compute_log_prob(thetas)[0], random_state=random_state
    )


def _advance(
    sampler: emcee.EnsembleSampler, state: emcee.State, count: int
) -> tuple[emcee.State, Stretch]:
    sampler.reset()
    state = sampler.run_mcmc(state, count, skip_initial_state_check=True)
    accepted = int(np.sum(sampler.backend.accepted))
    stretch = Stretch(sampler.get_chain(), sampler.get_log_prob(), accepted, state.random_state)
    return state, stretch


def key_of(posterior: Posterior, settings: Settings, method: str = "emcee") -> str:
    """Digest of everything that a chain depends on."""
    leaves, shape = jax.tree.flatten(posterior)
    digest = hashlib.sha256(repr((str(shape), settings, method)).encode())
    for leaf in leaves:
        digest.update(np.ascontiguousarray(leaf).tobytes())
    return digest.hexdigest()
