"""From a pad's tests and the user's choices to a search over hypotheses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from qlvbayes.diagnosis.prior import Families
from qlvbayes.diagnosis.protocol import protocol_of
from qlvbayes.diagnosis.search import Search, Tell
from qlvbayes.diagnosis.settings import Settings
from qlvbayes.effects.catalogue import EFFECTS, FORMS, OUTSIDE
from qlvbayes.effects.effect import AbstractEffect
from qlvbayes.fitting.marginal_likelihood import known_floor
from qlvbayes.inference.density import Density
from qlvbayes.inference.errors.discrepancy import Discrepancy
from qlvbayes.inference.forward.hypothesis import Hypothesis
from qlvbayes.inference.forward.space import Space, in_natural_amplitude
from qlvbayes.io.checks import InputError
from qlvbayes.laws.elastic.law import AbstractElastic
from qlvbayes.laws.relaxation.law import AbstractRelaxation
from qlvbayes.laws.relaxation.prony import Prony
from qlvbayes.model.choices import Choices
from qlvbayes.model.model import Model
from qlvbayes.model.noise import AbstractGaussian, Correlated, Floor
from qlvbayes.motion.experiment import Experiment
from qlvbayes.priors.natural import in_own_numbers


def as_chosen(experiment: Experiment, choices: Choices) -> Experiment:
    """The experiment with a history and a noise floor as the user wants them taken."""
    floor, noise = experiment.floor, choices.build(experiment.scales)[1]
    if isinstance(noise, Floor):
        floor = known_floor(floor, noise)
    if choices.noise == "white":
        floor = replace(floor, white=floor.total, ou=0.0)
    return replace(experiment, rested=choices.rested, floor=floor)


def search_of(
    experiment: Experiment,
    choices: Choices | None = None,
    *,
    kinds: Sequence[type[AbstractEffect]] = EFFECTS,
    settings: Settings | None = None,
    tell: Tell = lambda text: None,
) -> Search:
    """A search, not begun yet, over every law and effect that these tests can speak of.

    Beside the effects of ``kinds`` their other forms and what names nothing are looked for. Effects
    made of a velocity or an acceleration that the records do not give are left out. Raises
    InputError where the noise model chosen is not Gaussian.
    """
    choices, settings = choices or Choices(), settings or Settings()
    experiment = as_chosen(experiment, choices)
    model, noise = choices.build(experiment.scales)
    if not isinstance(noise, AbstractGaussian):
        raise InputError(
            "the diagnosis needs normal noise", remedy="use --noise floor or --noise white"
        )
    listed = {kind.name for kind in kinds}
    kinds = (*kinds, *(one for one in FORMS if one.family() in listed), *OUTSIDE)
    space = _space(experiment, choices, model, kinds, settings)
    discrepancy = Discrepancy.from_blocks(
        experiment,
        experiment.trials,
        space.record.blocks,
        settings.tolerance,
        settings.discrepancy,
    )
    names = frozenset(effect.name for effect in model.effects)
    usual = Hypothesis(choices.law, choices.relaxing, names)
    families = Families.of_kinds(type(effect) for effect in space.effects.values())
    density = Density(space, discrepancy.whitener, discrepancy)
    return Search(density, settings, usual, families, tell)


def _space(
    experiment: Experiment,
    choices: Choices,
    model: Model,
    kinds: Sequence[type[AbstractEffect]],
    settings: Settings,
) -> Space:
    """Laws and effects with their priors: the user's own, and all others' defaults."""
    scales = experiment.scales
    protocol = protocol_of(experiment, bonded=choices.bonded, settings=settings)
    effects = {effect.name: effect for effect in model.effects}
    chosen = {effect.family() for effect in model.effects}
    for kind in kinds:
        pointless = choices.bonded and kind.name == "adhesion"
        if kind.family() not in chosen and kind.unmeasured(protocol) is None and not pointless:
            effects[kind.name] = kind.default(scales)
    elastic: dict[str, AbstractElastic] = {
        kind.name: kind.default(scales) for kind in choices.laws.elastic
    }
    relaxation: dict[str, AbstractRelaxation] = {
        kind.name: kind.default(scales) for kind in choices.laws.relaxation if kind is not Prony
    }
    # a Prony series of the user's own number of modes only: one more is an effect
    relaxation[f"prony:{choices.modes}"] = Prony.with_modes(scales, choices.modes)
    elastic[choices.law] = model.elastic
    relaxation[choices.relaxing] = model.relaxation
    return Space(
        experiment.record(experiment.trials),
        {name: in_own_numbers(law) for name, law in elastic.items()},
        {name: in_own_numbers(law) for name, law in relaxation.items()},
        {name: in_own_numbers(in_natural_amplitude(effect)) for name, effect in effects.items()},
        Correlated.from_floor(experiment.floor),
        choices.bonded,
    )
