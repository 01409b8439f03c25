"""Estimate the constants of a pad from its tests, by emcee or by the paper's least squares.

A fit is written as ArviZ takes it.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import arviz_base
import numpy as np
import xarray

import qlvbayes
from qlvbayes.fitting.ensemble import (
    STEPS_PER_TIME,
    Chain,
    ChainStore,
    Diagnostics,
    Progress,
    Settings,
    diagnose_chain,
    key_of,
)
from qlvbayes.fitting.least_squares import (
    NormalApproximation,
    one_step,
    part_notice,
    two_step,
)
from qlvbayes.fitting.marginal_likelihood import white_likelihood
from qlvbayes.fitting.optimum import find_start, predictor_of
from qlvbayes.fitting.posterior import Posterior
from qlvbayes.fitting.prediction import Prediction, predict
from qlvbayes.fitting.residuals import CheckResult, check_experiment
from qlvbayes.fitting.results import SCHEMA
from qlvbayes.fitting.summary import FitSummary, constant_of, lasting_of
from qlvbayes.io import catalogue
from qlvbayes.io.checks import check_known
from qlvbayes.io.runtime import one_blas_thread
from qlvbayes.io.wording import plain
from qlvbayes.laws.relaxation.law import unresolved_times
from qlvbayes.model.choices import Choices
from qlvbayes.model.noise import Floor, White
from qlvbayes.model.parameters import all_fields, described, unit_kinds
from qlvbayes.motion.experiment import Experiment, Trial
from qlvbayes.motion.facts import covered
from qlvbayes.motion.record import Record
from qlvbayes.motion.specimen import carryover_notices

Sampler = Callable[
    [Posterior, NormalApproximation, Settings, ChainStore | None, Progress | None], Chain
]
_Setup = tuple[str, str, Choices, Settings, Experiment, tuple[Trial, ...]]
"""Pad, method, choices, settings, experiment and fitted trials: the first fields of a `Fit`."""
SAMPLERS: dict[str, Sampler] = catalogue.loaded(catalogue.SAMPLERS)
_MEMBER = re.compile(r"(.+)\[(\d+)\]")
_KEPT = 2000  # largest number of draws kept in the results
_NORMAL_DRAWS = (4, 1000)  # chains and draws that represent a normal approximation


@dataclass(frozen=True, eq=False)
class Fit:
    """Draws of every constant of one pad.

    pad, method, choices, settings: Name of the pad, method, model, and settings of the sampler;
    least squares use its seed alone; experiment, trials: Tests of the pad, and those that were
    fitted; posterior: Posterior of these trials; theta: Draws (chains, draws, D) of the free
    parameters, thinned; every: Draws (chains, steps, P) of the constants that ``names`` lists,
    moved by what a discrepancy may have moved them by, from which means are computed; chain:
    Constants (chains, steps, P) as they were sampled, where the curve follows the data.
    Diagnostics are computed from these; enough: Whether the sampling suffices; facts: Figures of
    the sampling, by name.
    """

    pad: str
    method: str
    choices: Choices
    settings: Settings
    experiment: Experiment
    trials: tuple[Trial, ...]
    posterior: Posterior
    theta: np.ndarray
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
    def constants(self) -> np.ndarray:
        """Return draws (chains, draws, P) of the constants, thinned."""
        return self.every[:, :: int(self.facts.get("thinned_by", 1))]

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
        judged: Diagnostics | None = None
        troubles = [] if self.enough else ["no two starts came to the same optimum"]
        if self.method in SAMPLERS:
            judged = diagnose_chain(self.chain)
            troubles = judged.troubles
            steps, time = self.facts["kept_steps"], self.facts["autocorrelation_steps"]
            if steps < STEPS_PER_TIME * time:
                text = f"{steps:.0f} steps are less than {STEPS_PER_TIME} autocorrelation times of"
                troubles = [*troubles, f"{text} {time:.0f}"]
        named = enumerate(zip(self.names, self.units, strict=True))
        constants = {n: constant_of(self.every[..., k], u, k, judged) for k, (n, u) in named}
        return FitSummary(
            pad=self.pad, units=self.experiment.units, effects=self.choices.effects,
            sampler=self.method, converged=not troubles, troubles=tuple(troubles),
            notices=tuple(_notices(self)), settings=self.settings, parameters=constants,
            never_relaxes=lasting_of(self.choices, self.names, self.every),
        )  # fmt: skip

    @property
    def inference_data(self) -> xarray.DataTree:
        """Return posterior, predictions, log likelihoods and data as ArviZ takes them.

        It is the ``xarray.DataTree`` that ``posterior.nc`` holds, for any function of ArviZ.
        """
        every = len(self.trials) == len(self.experiment.trials)
        seed = self.settings.seed
        return to_arviz(self, self.summary(), source="", sha256="", all_tests=every, seed=seed)

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
    trials, rng = experiment.with_role("fit"), np.random.default_rng(settings.seed)
    if method not in SAMPLERS:
        check_known("method", method, catalogue.METHODS)
        choices = independent_noise(choices)
    setup = experiment.pad, method, choices, settings, experiment, trials
    with one_blas_thread():  # its products are small
        if method in SAMPLERS:
            return _sampled(setup, folder, progress, rng)
        return _approximated(setup, rng)


def independent_noise(choices: Choices) -> Choices:
    """Return the choices of a least-squares method: independent noise of the residuals' own sd."""
    return replace(choices, noise="white")


def _sampled(
    setup: _Setup, folder: Path | None, progress: Progress | None, rng: np.random.Generator
) -> Fit:
    """Return the fit by a sampler."""
    _, method, choices, settings, experiment, trials = setup
    start = find_start(experiment, choices, trials, settings.seed)
    posterior, own = start.posterior, start.posterior.parameters
    store = ChainStore(folder, key_of(posterior, settings, method)) if folder else None
    chain = SAMPLERS[method](posterior, start.normal, settings, store, progress)
    steps, walkers = chain.log_density.shape
    thin = max(1, -(-steps * walkers // _KEPT))
    theta = np.swapaxes(chain.theta, 0, 1)
    constants = _constants(posterior, theta, rng)
    every = constants
    if start.spread is not None:  # a discrepancy may have moved the constants
        noise = constants.reshape(-1, constants.shape[-1])[:, posterior.of_noise]
        moves = start.spread.draws(noise[:, -1], rng)  # the last one is the discrepancy's size
        every = own.constants(own.within(theta.reshape(-1, theta.shape[-1]) + moves))
        every[:, posterior.of_noise] = noise
        every = every.reshape(constants.shape)
    facts = {
        "autocorrelation_steps": chain.autocorrelation, "acceptance": chain.acceptance,
        "steps": chain.steps, "kept_steps": steps, "walkers": walkers, "thinned_by": thin,
    }  # fmt: skip
    draws = theta[:, ::thin], every, constants
    return Fit(*setup, posterior, *draws, chain.enough, facts)


def _approximated(setup: _Setup, rng: np.random.Generator) -> Fit:
    """Return the fit by a least-squares route."""
    _, method, choices, _, experiment, trials = setup
    predictor = predictor_of(experiment, choices, trials)
    route = one_step if method == "least-squares" else two_step
    result = route(experiment, predictor, rng)
    chains, draws = _NORMAL_DRAWS
    theta = result.draws(chains * draws, rng)
    moved = theta + rng.standard_normal((len(theta), len(result.moves))) @ result.moves
    moved = predictor.parameters.within(moved).reshape(chains, draws, -1)
    theta = theta.reshape(chains, draws, -1)
    residual_sd = result.residual_sd
    noise = White(residual_sd)
    likelihood = white_likelihood(noise, predictor.record.blocks, experiment.scales.noise)
    posterior = Posterior(predictor.space, predictor.hypothesis, noise, likelihood)
    curves, every = _constants(posterior, theta, rng), _constants(posterior, moved, rng)
    facts = {"residual_sd": residual_sd, "starts_agreeing": result.agreeing}
    return Fit(*setup, posterior, theta, every, curves, result.agreeing > 1, facts)


def _notices(fit: Fit) -> Iterator[str]:
    """Yield what tests carry over from each other or cannot determine, at median constants."""
    constants = np.median(fit.constants.reshape(-1, fit.constants.shape[-1]), axis=0)

    def predicted(record: Record) -> np.ndarray:
        return np.asarray(fit.posterior.over(record).forces(constants[None])[0])

    sds = {trial.name: trial.test.contact_sd for trial in fit.trials if trial.test.contact_sd}
    if sds and (isinstance(fit.posterior.noise, Floor) or fit.method == "least-squares"):
        listed = ", ".join(f"{name} {plain(sd, 2)}" for name, sd in sds.items())
        if len(set(sds.values())) == 1 and len(sds) == len(fit.trials):
            listed = plain(next(iter(sds.values())), 2)
        yield (
            f"pad {fit.pad}: the contact point is uncertain, and the constants' intervals include "
            f"this (standard error in {fit.experiment.units.displacement}: {listed})"
        )
    yield from carryover_notices(fit.experiment, fit.trials, fit.posterior.record, predicted)
    model = fit.posterior.parameters.model_at(constants)
    times = unresolved_times(model.relaxation, fit.experiment.scales)
    for text in (*fit.experiment.floor.notices, *times):
        yield f"pad {fit.pad}: {text}"
    if fit.method not in SAMPLERS:
        yield from part_notice(fit.experiment, fit.method)


def _constants(posterior: Posterior, theta: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return constants (..., P) at thetas (..., D)."""
    flat = theta.reshape(-1, theta.shape[-1])
    return posterior.drawn_constants(flat, rng).reshape(*theta.shape[:-1], -1)


def to_arviz(
    fit: Fit, summary: FitSummary, *, source: str, sha256: str, all_tests: bool, seed: int
) -> xarray.DataTree:
    """Return a fit as a tree of posterior, predictive, log likelihood and data."""
    posterior, dims, coords = _grouped(fit.names, fit.constants)
    units, blocks = fit.experiment.units, fit.posterior.record.blocks
    force, real, shape = units.force_name, np.asarray(blocks.real), fit.theta.shape[:2]
    followed = fit.followed.reshape(-1, fit.followed.shape[-1])
    likelihood, predicted = fit.posterior.judged(followed, np.random.default_rng(seed))
    moved = not np.array_equal(fit.followed, fit.constants)
    curve = {"curve": _grouped(fit.names, fit.followed)[0]} if moved else {}
    fields = {"first_s": "first", "last_s": "last", "samples": "count", "weight": "weight"}
    facts = {"test": np.repeat(np.arange(len(real))[:, None], real.shape[1], axis=1)[real]}
    facts |= {name: np.asarray(getattr(blocks, field))[real] for name, field in fields.items()}
    coords["block"] = np.arange(int(real.sum()))
    dims |= {name: ["block"] for name in (force, *facts)}
    tree = arviz_base.from_dict(
        {
            "posterior": posterior,
            **curve,
            "posterior_predictive": {force: predicted.reshape(*shape, -1)},
            "log_likelihood": {force: likelihood.reshape(*shape, -1)},
            "observed_data": {force: np.asarray(blocks.force)[real]},
            "constant_data": facts,
        },
        coords=coords,
        dims=dims,
    )
    for name, unit in zip(fit.names, fit.units, strict=True):
        tree["posterior"][_split(name)[0]].attrs["units"] = unit
    for group in ("posterior_predictive", "observed_data"):
        tree[group][force].attrs["units"] = units.force
    for name in ("first_s", "last_s"):
        tree["constant_data"][name].attrs["units"] = "s"
    for node in tree.subtree:
        node.attrs.pop("created_at", None)  # the same fit gives the same file
    tree.attrs.update({
        "schema": SCHEMA, "pad": fit.pad, "method": fit.method,
        "converged": int(summary.converged), "choices": json.dumps(fit.choices.as_dict()),
        "priors": json.dumps(described(all_fields(fit.posterior))),
        "effects": json.dumps(list(fit.choices.effects)),
        "fitted_tests": json.dumps([trial.name for trial in fit.trials]),
        "all_tests": int(all_tests), "fluid": fit.experiment.fluid or "",
        "covered": json.dumps(covered(fit.experiment).as_dict()),
        "source": source, "sha256": sha256, "seed": seed,
        "displacement_unit": units.displacement, "force_unit": units.force,
        "qlvbayes_version": qlvbayes.__version__, **fit.facts,
    })  # fmt: skip
    return tree


def _split(name: str) -> tuple[str, int | None]:
    """Return the vector's name and the index of one of its members: ``v`` and 1 of ``v[1]``."""
    match = _MEMBER.fullmatch(name)
    return (match[1], int(match[2])) if match else (name, None)


def _grouped(names: list[str], constants: np.ndarray) -> tuple[dict, dict, dict]:
    """Return variables (c and v as vectors), their dimensions and their coordinates."""
    members: dict[str, dict[int | None, int]] = {}
    for column, name in enumerate(names):
        key, index = _split(name)
        members.setdefault(key, {})[index] = column
    variables, dims, coords = {}, {}, {}
    for key, columns in members.items():
        if None in columns:
            variables[key] = constants[..., columns[None]]
            continue
        variables[key] = constants[..., list(columns.values())]
        dims[key] = [f"{key}_index"]
        coords[f"{key}_index"] = np.array(list(columns))
    return variables, dims, coords
