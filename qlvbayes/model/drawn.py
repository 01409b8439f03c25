"""Say which model draws of a posterior describe, and make models of them.

Draws of another program describe one by the names of their constants.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import equinox as eqx
import jax
import numpy as np

from qlvbayes.effects.effect import Level
from qlvbayes.io.checks import InputError
from qlvbayes.io.units import PAD, STRAIN, UnitSystem, unit_system
from qlvbayes.io.wording import joined
from qlvbayes.laws.catalogue import LAWS
from qlvbayes.laws.relaxation.prony import Prony
from qlvbayes.laws.scales import Scales
from qlvbayes.model.choices import Choices
from qlvbayes.model.model import Model
from qlvbayes.model.noise import NOISES, AbstractNoise, neutral_names
from qlvbayes.model.parameters import Field, fields_of, is_prior, value_shape

# priors are replaced by draws, so that these scales only set the number of nodes of a
# continuous spectrum: ten decades (s) hold those of any tests
_SCALES = Scales(force=1.0, depth=1.0, shortest=1e-5, longest=1e5, white=1e-2, ou=1e-2, tau=1.0)
_POWERS = {"power_stiffness": "displacement", "power_drag": "speed"}


def described_model(choices: Choices, depth: float = 1.0) -> Model:
    """Return the model that the choices describe, with priors that do not matter."""
    return choices.build(replace(_SCALES, depth=depth))[0]


def described_fields(choices: Choices) -> list[Field]:
    """Return the fields of the model, then those of the noise."""
    model, noise = choices.build(_SCALES)
    return [*fields_of(model), *fields_of(noise)]


def rig_effects(model: Model) -> tuple[str, ...]:
    """Return the names of the effects of the frame and the sensors, which are not the pad's."""
    return tuple(effect.name for effect in model.effects if effect.level >= Level.FRAME)


def pad_alone(model: Model) -> Model:
    """Return the model without the effects of the rig."""
    for name in rig_effects(model):
        model = model.without(name)
    return model


def drawn_models(model: Model, names: Sequence[str], draws: np.ndarray) -> Model:
    """Return a model whose numbers have a leading axis: the draws (n, P) of the named constants."""
    columns = {name: draws[:, k] for k, name in enumerate(names)}
    wanted = [field.names for field in fields_of(model)]
    missing = [name for names in wanted for name in names if name not in columns]
    if missing:
        raise InputError(f"the posterior lacks {', '.join(missing)}", remedy="add its draws")
    leaves, shape = jax.tree.flatten(model, is_leaf=is_prior)
    values = [
        np.stack([columns[name] for name in names], axis=-1).reshape(-1, *value_shape(leaf))
        for names, leaf in zip(wanted, leaves, strict=True)
    ]
    return jax.tree.unflatten(shape, values)


def lasting_share(choices: Choices, names: Sequence[str], draws: np.ndarray) -> np.ndarray | None:
    r"""Return the share (n,) of a step's force that never relaxes, of draws (n, P) of constants.

    It is the first fraction :math:`c_0` of the relaxation, after the effects that change it: an
    extra mode of share c leaves :math:`(1 - c) c_0`. None where an effect makes it depend on depth.
    """
    drawn = drawn_models(described_model(choices), names, draws)
    one = jax.tree.map(lambda leaf: leaf[0], drawn)
    spectrum = one.relaxation.spectrum()
    if any(effect.spectrum(*spectrum) is None for effect in one.reshaping):
        return None
    return np.asarray(eqx.filter_vmap(Model.spectrum)(drawn)[0][:, 0])


def factors(
    choices: Choices, draws: Mapping[str, np.ndarray], given: UnitSystem, wanted: UnitSystem
) -> dict[str, np.ndarray | float]:
    """Return the factors that convert the draws (n,) of each constant to the wanted units."""
    if given.dimensionless != wanted.dimensionless:
        raise InputError(
            "strain and stress cannot be converted to displacement and force",
            remedy="compare force with force, or stress with stress",
        )
    kinds = {name: field.unit for field in described_fields(choices) for name in field.names}
    by_name: dict[str, np.ndarray | float] = {}
    for name in draws:
        if (base := _POWERS.get(kinds[name])) is None:
            by_name[name] = given.factor_to(wanted, kinds[name])
            continue
        stem, dot, _ = name.rpartition(".")
        exponent = draws[f"{stem}{dot}n"]
        by_name[name] = given.factor_to(wanted, "force") / given.factor_to(wanted, base) ** exponent
    return by_name


FEWEST = 100  # draws that a 90 % interval needs
_SUM = 1e-3  # by which the sum of the fractions c may differ from 1


def infer_choices(
    names: Iterable[str], *, bonded: bool = False, effects_file: str | None = None
) -> Choices:
    """Return the choices of the model that has constants of these names."""
    given = set(names)
    if "m" not in given:
        raise InputError("the posterior has no m, the stiffness", remedy="name its constant m")
    fitting = [kind for kind in LAWS.elastic if set(kind.units) <= given]
    law = max(fitting, key=lambda kind: len(kind.units)).name
    modes = max((k for name in given for k in _indices(name, "v")), default=0)
    modes = max([modes, *(k for name in given for k in _indices(name, "c"))])
    relaxation = _relaxation(given)
    if modes == 0 and relaxation == Prony.name:
        raise InputError("the posterior has no v[1] and c[0], c[1]", remedy="add its relaxation")
    effects = dict.fromkeys(name.split(".")[0] for name in sorted(given) if "." in name)
    effects.pop("noise", None)
    choices = Choices(
        elastic=law,
        modes=modes or Choices.modes,
        relaxation=relaxation,
        bonded=bonded,
        noise=_noise(given),
        effects=tuple(effects),
        effects_file=effects_file,
    )
    wanted = wanted_names(choices, given)
    neutral = neutral_names(NOISES[choices.noise])
    if missing := [name for name in wanted if name not in given and name not in neutral]:
        raise InputError(
            f"the posterior lacks {', '.join(missing)}",
            remedy=f"{_model(choices)} has {', '.join(wanted)}",
        )
    return choices


def has_noise(names: Iterable[str]) -> bool:
    """Return whether there are constants of a noise model among the names."""
    return any(name.startswith("noise.") for name in names)


def wanted_names(choices: Choices, given: Iterable[str]) -> list[str]:
    """Return the names of a model's constants, in order, with the noise's where they are given."""
    noise = has_noise(given)
    all_names = [name for field in described_fields(choices) for name in field.names]
    return [name for name in all_names if noise or not name.startswith("noise.")]


def completed(choices: Choices, draws: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the draws of a model's constants by name, in order; the noise's only where given.

    What a posterior may leave out of its noise has its neutral value.
    """
    neutral = neutral_names(NOISES[choices.noise])
    like = np.ones_like(next(iter(draws.values())))
    return {
        name: np.asarray(draws[name] if name in draws else neutral[name] * like, float)
        for name in wanted_names(choices, draws)
    }


def check_draws(choices: Choices, draws: Mapping[str, np.ndarray]) -> None:
    """Raise InputError unless the draws are finite, fractions sum to 1, and rates fall."""
    if (count := min(np.size(values) for values in draws.values())) < FEWEST:
        raise InputError(f"only {count} draws", remedy=f"give {FEWEST} or more")
    for name, values in draws.items():
        if not np.all(np.isfinite(values)):
            raise InputError(f"{name} has draws that are not finite", remedy="leave them out")
    if not choices.is_prony:
        return
    total = sum(draws[f"c[{k}]"] for k in range(choices.modes + 1))
    if np.max(np.abs(total - 1.0)) > _SUM:
        raise InputError("the fractions c do not sum to 1", remedy="give c[0] as 1 less the others")
    for k in range(1, choices.modes):
        if np.median(draws[f"v[{k}]"]) < np.median(draws[f"v[{k + 1}]"]):
            raise InputError(f"v[{k}] is below v[{k + 1}]", remedy="order the modes by falling v")


def stated_units(
    displacement: str | None, force: str | None, units: Mapping[str, str]
) -> UnitSystem:
    """Return the units that a file states, or those that follow from m's unit."""
    m, _, of_m = units.get("m", "").partition("/")
    if displacement is None and m and _known(of_m or STRAIN.displacement, m):
        return unit_system(of_m or STRAIN.displacement, m)
    baseline = STRAIN if displacement == STRAIN.displacement else PAD
    stated = displacement or baseline.displacement, force or baseline.force
    if not _known(*stated):
        raise InputError(
            f"displacement in {stated[0]} and force in {stated[1]} do not go together",
            remedy="state displacement_unit mm, um, nm or m with force_unit N, mN, uN or nN, or 1 "
            "with kPa, MPa or Pa",
        )
    return unit_system(*stated)


def _known(displacement: str, force: str) -> bool:
    try:
        unit_system(displacement, force)
    except KeyError:
        return False
    return True


def flat_names(key: str, labels: Sequence[object], size: int) -> list[str]:
    """Return the names of a vector's members."""
    first = Prony.first_index.get(key, 0)
    counts = [label for label in labels if isinstance(label, (int, np.integer))]
    counted = counts == sorted(set(counts)) and len(counts) == size
    # a coordinate that nobody chose counts from 0, also for v
    chosen = counted and not (first and counts[0] == 0)
    indices = counts if chosen else range(first, first + size)
    return [f"{key}[{int(k)}]" for k in indices]


def pad_name(path: Path) -> str:
    """Return the name of a pad whose file states none: its folder's, as in the results' folders."""
    return path.resolve().parent.name or path.stem


def _model(choices: Choices) -> str:
    if choices.is_prony:
        return f"a model of {choices.modes} relaxation modes"
    return f"a model with the relaxation {choices.relaxation}"


def _relaxation(given: set[str]) -> str:
    """Return the relaxation law whose constants are all there, or a Prony series if none is."""
    complete = [kind.name for kind in LAWS.relaxation if set(kind.units) <= given]
    return complete[0] if complete else Prony.name


def _indices(name: str, key: str) -> list[int]:
    match = re.fullmatch(rf"{key}\[(\d+)\]", name)
    return [int(match[1])] if match else []


def _needed(kind: type[AbstractNoise]) -> list[str]:
    """Return the names of the constants that every posterior with this noise has."""
    return [kind.prefix + name for name in kind.units if name not in kind.neutral]


def _noise(given: set[str]) -> str:
    for name, kind in NOISES.items():
        if set(_needed(kind)) <= given:
            return name
    if has_noise(given):
        present = ", ".join(sorted(name for name in given if name.startswith("noise.")))
        kinds = sorted(NOISES.values(), key=lambda kind: len(kind.units))
        wanted = ", or ".join(joined(_needed(kind)) for kind in kinds)
        raise InputError(f"the posterior's noise has only {present}", remedy=f"give {wanted}")
    return "white"
