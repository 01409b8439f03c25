"""Make models of a posterior's draws; their constants are numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import equinox as eqx
import jax
import numpy as np

from qlvbayes.effects.effect import Level
from qlvbayes.io.checks import InputError
from qlvbayes.io.units import UnitSystem
from qlvbayes.laws.scales import Scales
from qlvbayes.model.choices import Choices
from qlvbayes.model.model import Model
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
