"""Estimate the constants of a pad from its tests, by emcee or by the paper's least squares."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from qlvbayes.fitting.chainstore import ChainStore
from qlvbayes.fitting.diagnostics import diagnose_chain
from qlvbayes.fitting.ensemble import STEPS_PER_TIME, Chain, Progress, Settings, key_of
from qlvbayes.fitting.least_squares import NormalApproximation, fitting_draws
from qlvbayes.fitting.marginal_likelihood import Spread, white_likelihood
from qlvbayes.fitting.optimum import find_start, predictor_of
from qlvbayes.fitting.posterior import Posterior
from qlvbayes.fitting.prediction import Prediction, predict
from qlvbayes.fitting.residuals import CheckResult, check_experiment
from qlvbayes.fitting.routes import one_step, part_notice, two_step
from qlvbayes.fitting.summary import FitSummary, constant_of
from qlvbayes.io import catalogue
from qlvbayes.io.checks import check_known
from qlvbayes.io.runtime import one_blas_thread
from qlvbayes.io.units import UnitSystem
from qlvbayes.io.wording import plain
from qlvbayes.laws.relaxation.law import unresolved_times
from qlvbayes.model.choices import Choices
from qlvbayes.model.noise import Floor, White
from qlvbayes.model.parameters import unit_kinds
from qlvbayes.motion.experiment import Experiment, Trial
from qlvbayes.motion.record import Record
from qlvbayes.motion.specimen import carryover_notices, clock_notices

Sampler = Callable[
    [Posterior, NormalApproximation, Settings, ChainStore | None, Progress | None], Chain
]
SAMPLERS: dict[str, Sampler] = catalogue.loaded(catalogue.SAMPLERS)
_KEPT = 2000  # largest number of draws kept in the results
_NORMAL_DRAWS = (4, 1000)  # chains and draws that represent a normal approximation


@dataclass(frozen=True, eq=False)
class Fit:
    """Draws of every constant of one pad.

    pad, method, choices, settings: Name of the pad, method, model, and settings of the sampler;
    least squares use its seed alone; experiment, trials: Tests of the pad, and those that were
    fitted; posterior: Posterior of these trials; theta: Draws (chains, draws, D) of the free
    parameters, thinned; constants: Draws (chains, draws, P) of the constants that ``names`` lists,
    thinned, moved by what a discrepancy may have moved them by; every: The same before thinning
    (chains, steps, P), from which means are computed; chain: Constants (chains, steps, P) as they
    were sampled, where the curve follows the data. Diagnostics are computed from these; enough:
    Whether the sampling suffices; facts: Figures of the sampling, by name.
    """

    pad: str
    method: str
    choices: Choices
    settings: Settings
    experiment: Experiment
    trials: tuple[Trial, ...]
    posterior: Posterior
    theta: np.ndarray
    constants: np.ndarray
    every: np.ndarray
    chain: np.ndarray
    enough: bool
    facts: dict[str, float] = field(default_factory=dict)

    @property
    def names(self) -> list[str]:
        """Return the names of the P constants."""
        return self.posterior.names

    @property
    def units(self) -> list[str]:
        """Return the unit of each constant."""
        return [self.experiment.units.of(kind) for kind in unit_kinds(self.posterior)]

    @property
    def draws(self) -> dict[str, np.ndarray]:
        """Return draws (chains*draws,) of each constant, by name."""
        return self._by_name(self.constants)

    @property
    def followed(self) -> np.ndarray:
        """Return thinned constants (chains, draws, P) where the curve follows the data."""
        return self.chain[:, :: int(self.facts.get("thinned_by", 1))]

    @property
    def curve_draws(self) -> dict[str, np.ndarray]:
        """Return draws (chains*draws,) by name where the curve follows the data; these predict."""
        return self._by_name(self.followed)

    def _by_name(self, constants: np.ndarray) -> dict[str, np.ndarray]:
        """Return constants (..., P) as one column for each name."""
        columns = constants.reshape(-1, constants.shape[-1]).T
        return dict(zip(self.names, columns, strict=True))

    def summary(self) -> FitSummary:
        """Return means, intervals and diagnostics of every constant, before thinning."""
        diagnostics = diagnose_chain(self.chain) if self.method in SAMPLERS else None
        troubles = (*(diagnostics.troubles if diagnostics else ()), *_length_troubles(self))
        return FitSummary(
            pad=self.pad,
            units=self.experiment.units,
            effects=self.choices.effects,
            sampler=self.method,
            converged=not troubles,
            troubles=troubles,
            notices=tuple(_notices(self)),
            settings=self.settings,
            parameters={
                name: constant_of(self.every[..., k], unit, k, diagnostics)
                for k, (name, unit) in enumerate(zip(self.names, self.units, strict=True))
            },
        )

    @property
    def inference_data(self) -> Any:
        """Return posterior, predictions, log likelihoods and data as ArviZ takes them.

        It is the ``xarray.DataTree`` that ``posterior.nc`` holds, for any function of ArviZ.
        """
        return catalogue.at("fitting.results.to_arviz")(
            self, self.summary(), source="", sha256="",
            all_tests=len(self.trials) == len(self.experiment.trials), seed=self.settings.seed,
        )  # fmt: skip

    def predict(self, trials: Sequence[Trial] | None = None, *, seed: int = 0) -> list[Prediction]:
        """Predict tests sample by sample, with noise; return one `Prediction` for each.

        Parameters
        ----------
        trials, seed
            Of ``experiment.trials`` or others in the same units, all of the pad's by default; the
            seed is that of the choice of draws and of the noise.
        """
        chosen = self.experiment.trials if trials is None else trials
        return predict(self.experiment, self.choices, self.curve_draws, chosen, seed=seed)

    def check(self, *, seed: int = 0) -> CheckResult:
        """Check where the model fails, test by test and phase by phase, over all the pad's tests.

        Parameters
        ----------
        seed
            Seed of the choice of draws and of the noise.
        """
        return check_experiment(self.experiment, self.choices, self.predict(seed=seed))


def fit_pad(
    experiment: Experiment,
    choices: Choices,
    *,
    method: str = "emcee",
    settings: Settings | None = None,
    folder: Path | None = None,
    progress: Progress | None = None,
) -> Fit:
    """Fit the trials whose role is ``fit``."""
    settings = settings or Settings()
    experiment = replace(experiment, rested=choices.rested)
    trials = experiment.with_role("fit")
    if method not in SAMPLERS:
        check_known("method", method, catalogue.METHODS)
    with one_blas_thread():  # its products are small
        if method in SAMPLERS:
            return _sampled(experiment, choices, method, trials, settings, folder, progress)
        return _approximated(experiment, independent_noise(choices), settings, trials, method)


def independent_noise(choices: Choices) -> Choices:
    """Return the choices of a least-squares method: independent noise of the residuals' own sd."""
    return replace(choices, noise="white")


def _sampled(
    experiment: Experiment,
    choices: Choices,
    method: str,
    trials: tuple[Trial, ...],
    settings: Settings,
    folder: Path | None,
    progress: Progress | None,
) -> Fit:
    """Return the fit by a sampler."""
    rng = np.random.default_rng(settings.seed)
    start = find_start(experiment, choices, trials, settings.seed)
    posterior = start.posterior
    store = ChainStore(folder, key_of(posterior, settings, method)) if folder else None
    chain = SAMPLERS[method](posterior, start.normal, settings, store, progress)
    steps, walkers = chain.log_density.shape
    thin = max(1, -(-steps * walkers // _KEPT))
    theta = np.swapaxes(chain.theta, 0, 1)
    constants = _constants(posterior, theta, rng)
    every = constants
    if start.spread is not None:
        every = _moved(posterior, theta, constants, start.spread, rng)
    facts = {
        "autocorrelation_steps": chain.autocorrelation,
        "acceptance": chain.acceptance,
        "steps": chain.steps,
        "kept_steps": steps,
        "walkers": walkers,
        "thinned_by": thin,
    }
    setup = experiment.pad, method, choices, settings, experiment, trials, posterior
    draws = theta[:, ::thin], every[:, ::thin], every, constants
    return Fit(*setup, *draws, chain.enough, facts)


def _approximated(
    experiment: Experiment,
    choices: Choices,
    settings: Settings,
    trials: tuple[Trial, ...],
    method: str,
) -> Fit:
    """Return the fit by a least-squares route."""
    rng = np.random.default_rng(settings.seed)
    predictor = predictor_of(experiment, choices, trials)
    route = one_step if method == "least-squares" else two_step
    result = route(experiment, predictor, rng)
    chains, draws = _NORMAL_DRAWS
    theta = fitting_draws(predictor, result.scale, result.normal, chains * draws, rng)
    moved = theta + rng.standard_normal((len(theta), len(result.moves))) @ result.moves
    moved = predictor.parameters.within(moved).reshape(chains, draws, -1)
    theta = theta.reshape(chains, draws, -1)
    noise = White(result.residual_sd)
    likelihood = white_likelihood(noise, predictor.record.blocks, experiment.scales.noise)
    posterior = Posterior(predictor.space, predictor.hypothesis, noise, likelihood)
    curves, every = _constants(posterior, theta, rng), _constants(posterior, moved, rng)
    facts = {"residual_sd": result.residual_sd, "starts_agreeing": result.agreeing}
    setup = experiment.pad, method, choices, settings, experiment, trials, posterior
    return Fit(*setup, theta, every, every, curves, result.agreeing > 1, facts)


def _notices(fit: Fit) -> Iterator[str]:
    """Yield what tests carry over from each other or cannot determine, at median constants."""
    constants = np.median(fit.constants.reshape(-1, fit.constants.shape[-1]), axis=0)

    def predicted(record: Record) -> np.ndarray:
        return np.asarray(fit.posterior.over(record).forces(constants[None])[0])

    if isinstance(fit.posterior.noise, Floor) or fit.method == "least-squares":
        yield from _contact_notices(fit.pad, fit.trials, fit.experiment.units)
    yield from carryover_notices(fit.experiment, fit.trials, fit.posterior.record, predicted)
    if not fit.choices.rested:
        yield from clock_notices(fit.experiment)
    model = fit.posterior.parameters.model_at(constants)
    times = unresolved_times(model.relaxation, fit.experiment.scales)
    for text in (*fit.experiment.floor.notices, *times):
        yield f"pad {fit.pad}: {text}"
    if fit.method not in SAMPLERS:
        yield from part_notice(fit.experiment, fit.method)


def _contact_notices(pad: str, trials: Sequence[Trial], units: UnitSystem) -> Iterator[str]:
    """Yield that the error of the contact point is part of the fit, where it was measured."""
    sds = {trial.name: trial.test.contact_sd for trial in trials if trial.test.contact_sd}
    if sds:
        listed = ", ".join(f"{name} {plain(sd, 2)}" for name, sd in sds.items())
        unit = units.displacement
        yield (
            f"pad {pad}: the contact point is uncertain, and the constants' intervals include this "
            f"(standard error in {unit}: {listed})"
        )


def _length_troubles(fit: Fit) -> list[str]:
    """Return messages on a chain that is too short, or on least squares without agreement."""
    if fit.method not in SAMPLERS:
        return [] if fit.enough else ["no two starts came to the same optimum"]
    steps, time = fit.facts["kept_steps"], fit.facts["autocorrelation_steps"]
    if steps >= STEPS_PER_TIME * time:
        return []
    return [f"{steps:.0f} steps are less than {STEPS_PER_TIME} autocorrelation times of {time:.0f}"]


def _constants(posterior: Posterior, theta: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return constants (..., P) at thetas (..., D)."""
    flat = theta.reshape(-1, theta.shape[-1])
    return posterior.drawn_constants(flat, rng).reshape(*theta.shape[:-1], -1)


def _moved(
    posterior: Posterior,
    theta: np.ndarray,
    chain: np.ndarray,
    spread: Spread,
    rng: np.random.Generator,
) -> np.ndarray:
    """Return constants (..., P) with the moves that a discrepancy may have caused."""
    own, flat = posterior.parameters, theta.reshape(-1, theta.shape[-1])
    noise = chain.reshape(-1, chain.shape[-1])[:, posterior.of_noise]
    moves = spread.draws(noise[:, -1], rng)  # the last one is the discrepancy's size
    values = own.constants(own.within(flat + moves))
    values[:, posterior.of_noise] = noise
    return values.reshape(chain.shape)
