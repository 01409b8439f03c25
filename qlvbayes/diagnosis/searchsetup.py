"""The set-up of a search over hypotheses, from a pad's tests and the user's choices."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from qlvbayes.diagnosis.prior import Families
from qlvbayes.diagnosis.search import Search
from qlvbayes.diagnosis.settings import DiagnosisSettings
from qlvbayes.effects.catalogue import EFFECTS, FORMS, OUTSIDE
from qlvbayes.effects.effect import AbstractEffect, Protocol
from qlvbayes.fitting.marginal_likelihood import (
    has_uncertain_zeros,
    known_floor,
    with_zero_errors,
)
from qlvbayes.fitting.optimum import best_model
from qlvbayes.inference.density import Density, Point
from qlvbayes.inference.errors.discrepancy import Discrepancy
from qlvbayes.inference.forward.hypothesis import Hypothesis
from qlvbayes.inference.forward.space import Space, in_natural_amplitude
from qlvbayes.io.checks import InputError
from qlvbayes.laws.elastic.law import AbstractElastic
from qlvbayes.laws.relaxation.law import AbstractRelaxation
from qlvbayes.laws.relaxation.prony import Prony
from qlvbayes.model.choices import Choices
from qlvbayes.model.model import Model
from qlvbayes.model.noise import Correlated, Floor, White
from qlvbayes.motion.evidence import with_mass
from qlvbayes.motion.experiment import Experiment
from qlvbayes.motion.facts import at_one_depth, returns, unloads
from qlvbayes.motion.record import Record


def as_chosen(experiment: Experiment, choices: Choices) -> Experiment:
    """Return an experiment as the user's choices ask for, with the mass that its tests show."""
    floor, noise = experiment.floor, choices.build(experiment.scales)[1]
    if isinstance(noise, Floor):
        floor = known_floor(floor, noise)
    if choices.noise == "white":
        floor = floor.as_white(floor.total)
    return with_mass(replace(experiment, rested=choices.rested, floor=floor))


def build_search(
    experiment: Experiment,
    choices: Choices | None = None,
    *,
    kinds: Sequence[type[AbstractEffect]] = EFFECTS,
    settings: DiagnosisSettings | None = None,
) -> Search:
    """Return a search that has not begun yet, over all laws and effects that the tests can show."""
    choices, settings = choices or Choices(), settings or DiagnosisSettings()
    experiment = as_chosen(experiment, choices)
    model, noise = choices.build(experiment.scales)
    if not isinstance(noise, Floor | Correlated | White):
        raise InputError(
            f"the diagnosis does not know the noise model {choices.noise}",
            remedy="use --noise floor or --noise white",
        )
    names = {kind.name for kind in kinds}
    kinds = (*kinds, *(one for one in FORMS if one.family() in names), *OUTSIDE)
    space = _space(experiment, choices, model, kinds, settings)
    discrepancy = _discrepancy(experiment, space.record, settings)
    own = frozenset(effect.name for effect in model.effects)
    baseline = Hypothesis(choices.elastic, choices.relaxing, own)
    families = Families.from_kinds(type(effect) for effect in space.effects.values())
    density = Density(space, discrepancy)
    uncertain = has_uncertain_zeros(model, experiment.trials)
    about = partial(_about, experiment, settings) if uncertain else None
    return Search(density, settings, baseline, families, about=about)


def _discrepancy(
    experiment: Experiment, record: Record, settings: DiagnosisSettings
) -> Discrepancy:
    """Return the discrepancy of all tests, under a floor with the errors of their contacts."""
    trials, blocks = experiment.trials, record.blocks
    return Discrepancy.from_blocks(
        experiment, trials, blocks, settings.tolerance, settings.discrepancy, settings.scatter
    )


def _about(
    experiment: Experiment, settings: DiagnosisSettings, density: Density, point: Point
) -> Density:
    """Return the density with what the errors of contacts change of the force at a point."""
    record = with_zero_errors(
        density.space.record, experiment.trials, point.own.model_at(point.constants)
    )
    space = replace(density.space, record=record)
    whitener = _discrepancy(experiment, record, settings).whitener
    return Density(space, density.discrepancy.with_whitener(whitener))


def _record(experiment: Experiment, choices: Choices, model: Model) -> Record:
    """Return the record of all tests."""
    record = experiment.record(experiment.trials, errors=True)
    if not has_uncertain_zeros(model, experiment.trials):
        return record
    trials = experiment.trials
    return with_zero_errors(record, trials, best_model(experiment, choices, trials))


def _space(
    experiment: Experiment,
    choices: Choices,
    model: Model,
    kinds: Sequence[type[AbstractEffect]],
    settings: DiagnosisSettings,
) -> Space:
    """Return all laws and effects, with default priors unless the user gave others."""
    scales = experiment.scales
    protocol = protocol_of(experiment, bonded=choices.bonded, settings=settings)
    effects = {effect.name: effect for effect in model.effects}
    chosen = {effect.family() for effect in model.effects}
    for kind in kinds:
        pointless = choices.bonded and kind.family() == "adhesion"
        if kind.family() not in chosen and kind.unmeasured(protocol) is None and not pointless:
            effects[kind.name] = kind.default(scales)
    elastic: dict[str, AbstractElastic] = {
        kind.name: kind.default(scales) for kind in choices.laws.elastic
    }
    relaxation: dict[str, AbstractRelaxation] = {
        kind.name: kind.default(scales) for kind in choices.laws.relaxation if kind is not Prony
    }
    # only the user's number of Prony modes: one mode more is an effect
    relaxation[f"prony:{choices.modes}"] = Prony.with_modes(scales, choices.modes)
    elastic[choices.elastic] = model.elastic
    relaxation[choices.relaxing] = model.relaxation
    return Space(
        _record(experiment, choices, model),
        elastic,
        relaxation,
        {name: in_natural_amplitude(effect) for name, effect in effects.items()},
        Correlated.from_floor(experiment.floor),
        choices.bonded,
    )


def protocol_of(
    experiment: Experiment, *, bonded: bool, settings: DiagnosisSettings | None = None
) -> Protocol:
    """Return the protocol of an experiment, from the phases, motion and forces of its tests."""
    nearly = (settings or DiagnosisSettings()).returned
    return Protocol(
        unloads=unloads(experiment, nearly),
        returns=returns(experiment, nearly),
        tests=len(experiment.trials),
        bonded=bonded,
        curved=any(trial.trajectory.acceleration_resolved for trial in experiment.trials),
        timed=any(trial.trajectory.velocity_resolved for trial in experiment.trials),
        one_depth=at_one_depth(experiment, nearly),
        interval=experiment.interval,
        mass_shown=experiment.mass is not None,
    )
