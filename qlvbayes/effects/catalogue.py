"""List the effects that come with the package, and read a user's own."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from qlvbayes.effects import contacts, drags, fluids, frames, sensors, softening
from qlvbayes.effects.effect import AbstractEffect
from qlvbayes.io.catalogue import EFFECT_POINTS, at, check_own, installed, own_classes
from qlvbayes.io.checks import InputError, check_known

_CHECK = "effects.conformance.check_effect"  # which imports this list

EFFECTS: tuple[type[AbstractEffect], ...] = (
    drags.ViscousDrag,
    drags.PowerLawDrag,
    drags.SqueezeFilm,
    fluids.FluidPressure,
    softening.FluidLeak,
    softening.ExtraRelaxationMode,
    softening.StrainDependentRate,
    softening.StrainDependentStrength,
    softening.StressSoftening,
    softening.Thixotropy,
    softening.Conditioning,
    drags.Friction,
    contacts.SecondContact,
    contacts.InterfaceSlip,
    softening.PermanentSet,
    contacts.ContactOffset,
    frames.Backlash,
    contacts.Adhesion,
    frames.FrameCompliance,
    frames.FrameRinging,
    drags.Inertia,
    sensors.ForceOffset,
    sensors.ForceDrift,
    sensors.LoadCellCreep,
    sensors.ChannelLag,
)
"""The listed effects: those that a diagnosis looks for and names."""

FORMS: tuple[type[AbstractEffect], ...] = (
    drags.GuideDrag,
    drags.GuidePowerLawDrag,
    fluids.PowerLawDrainage,
    softening.LevellingLeak,
    drags.PressureFriction,
    drags.SharpFriction,
    drags.GuideFriction,
    contacts.GradualContact,
    contacts.AdhesionAtAStretch,
    frames.StiffeningFrame,
    sensors.LevellingDrift,
    sensors.SpreadingLag,
)
"""Other forms of listed effects; each contains the law of its listed effect, its family."""

OUTSIDE: tuple[type[AbstractEffect], ...] = (softening.SlowChange, sensors.OffsetsByTest)
"""Effects that name nothing: they stand for whatever the list does not hold."""

EVERY: tuple[type[AbstractEffect], ...] = (*EFFECTS, *FORMS, *OUTSIDE)
"""Every effect that comes with the package."""


def names(kinds: Sequence[type[AbstractEffect]] = EFFECTS) -> tuple[str, ...]:
    """Return the effects' names, as on the command line."""
    return tuple(kind.name for kind in kinds)


def by_family(
    kinds: Sequence[type[AbstractEffect]] = EVERY,
) -> dict[str, list[type[AbstractEffect]]]:
    """Return the effects of each family, the listed one first."""
    families: dict[str, list[type[AbstractEffect]]] = {}
    for kind in kinds:
        families.setdefault(kind.family(), []).append(kind)
    return families


def find(name: str, kinds: Sequence[type[AbstractEffect]] = EVERY) -> type[AbstractEffect]:
    """Return the effect of that name; an InputError lists the known ones otherwise."""
    check_known("effect", name, names(kinds))
    return next(kind for kind in kinds if kind.name == name)


def installed_effects() -> tuple[type[AbstractEffect], ...]:
    """Return the effects that installed packages add, by the entry points ``qlvbayes.effects``."""
    return installed(EFFECT_POINTS, "effect", names(EVERY), lambda kind: at(_CHECK)(kind))


def own_effects(path: str | Path) -> tuple[type[AbstractEffect], ...]:
    """Return the effects that a Python file defines, in its order; imported ones do not count."""
    path = Path(path)
    kinds = own_classes(path, AbstractEffect, "effects")  # type: ignore[type-abstract]
    if not kinds:
        raise InputError(
            "defines no effect", file=path, remedy="write a class that extends AbstractEffect"
        )
    check_own(path, kinds, AbstractEffect, "effect", names(EVERY))
    return kinds
