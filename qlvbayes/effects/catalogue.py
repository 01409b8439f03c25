"""List the effects that come with the package, and read a user's own."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from qlvbayes.effects.contacts import (
    Adhesion,
    AdhesionAtAStretch,
    ContactOffset,
    GradualContact,
    SecondContact,
)
from qlvbayes.effects.drags import (
    GuideDrag,
    GuidePowerLawDrag,
    Inertia,
    PowerLawDrag,
    SqueezeFilm,
    ViscousDrag,
)
from qlvbayes.effects.drifts import (
    FluidLeak,
    ForceDrift,
    ForceOffset,
    LevellingDrift,
    LevellingLeak,
    LoadCellCreep,
    OffsetsByTest,
    SlowChange,
)
from qlvbayes.effects.effect import AbstractEffect
from qlvbayes.effects.fluids import FluidPressure, PowerLawDrainage
from qlvbayes.effects.frames import Backlash, FrameCompliance, FrameRinging, StiffeningFrame
from qlvbayes.effects.friction import (
    Friction,
    GuideFriction,
    InterfaceSlip,
    PressureFriction,
    SharpFriction,
)
from qlvbayes.effects.lags import ChannelLag, SpreadingLag
from qlvbayes.effects.relaxing import (
    ExtraRelaxationMode,
    StrainDependentRate,
    StrainDependentStrength,
)
from qlvbayes.effects.softening import Conditioning, PermanentSet, StressSoftening, Thixotropy
from qlvbayes.io.catalogue import EFFECT_POINTS, at, check_own, installed, own_classes
from qlvbayes.io.checks import InputError, check_known

EFFECTS: tuple[type[AbstractEffect], ...] = (
    ViscousDrag,
    PowerLawDrag,
    SqueezeFilm,
    FluidPressure,
    FluidLeak,
    ExtraRelaxationMode,
    StrainDependentRate,
    StrainDependentStrength,
    StressSoftening,
    Thixotropy,
    Conditioning,
    Friction,
    SecondContact,
    InterfaceSlip,
    PermanentSet,
    ContactOffset,
    Backlash,
    Adhesion,
    FrameCompliance,
    FrameRinging,
    Inertia,
    ForceOffset,
    ForceDrift,
    LoadCellCreep,
    ChannelLag,
)
"""The listed effects: those that a diagnosis looks for and names."""

FORMS: tuple[type[AbstractEffect], ...] = (
    GuideDrag,
    GuidePowerLawDrag,
    PowerLawDrainage,
    LevellingLeak,
    PressureFriction,
    SharpFriction,
    GuideFriction,
    GradualContact,
    AdhesionAtAStretch,
    StiffeningFrame,
    LevellingDrift,
    SpreadingLag,
)
"""Other forms of listed effects; each contains the law of its listed effect, its family."""

OUTSIDE: tuple[type[AbstractEffect], ...] = (SlowChange, OffsetsByTest)
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

    def check(kind: type[AbstractEffect]) -> None:
        at("effects.conformance.check_effect")(kind)

    return installed(EFFECT_POINTS, "effect", names(EVERY), check)


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
