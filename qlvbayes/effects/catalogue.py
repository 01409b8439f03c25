"""List the effects that come with the package, and read a user's own."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from qlvbayes.effects.adhesion import Adhesion
from qlvbayes.effects.adhesion_at_a_stretch import AdhesionAtAStretch
from qlvbayes.effects.backlash import Backlash
from qlvbayes.effects.channel_lag import ChannelLag
from qlvbayes.effects.conditioning import Conditioning
from qlvbayes.effects.contact_offset import ContactOffset
from qlvbayes.effects.effect import AbstractEffect
from qlvbayes.effects.extra_relaxation_mode import ExtraRelaxationMode
from qlvbayes.effects.fluid_leak import FluidLeak
from qlvbayes.effects.fluid_pressure import FluidPressure
from qlvbayes.effects.force_drift import ForceDrift
from qlvbayes.effects.force_offset import ForceOffset
from qlvbayes.effects.frame_compliance import FrameCompliance
from qlvbayes.effects.frame_ringing import FrameRinging
from qlvbayes.effects.friction import Friction
from qlvbayes.effects.gradual_contact import GradualContact
from qlvbayes.effects.guide_drag import GuideDrag, GuidePowerLawDrag
from qlvbayes.effects.guide_friction import GuideFriction
from qlvbayes.effects.inertia import Inertia
from qlvbayes.effects.interface_slip import InterfaceSlip
from qlvbayes.effects.levelling_drift import LevellingDrift
from qlvbayes.effects.levelling_leak import LevellingLeak
from qlvbayes.effects.load_cell_creep import LoadCellCreep
from qlvbayes.effects.offsets_by_test import OffsetsByTest
from qlvbayes.effects.permanent_set import PermanentSet
from qlvbayes.effects.power_law_drag import PowerLawDrag
from qlvbayes.effects.power_law_drainage import PowerLawDrainage
from qlvbayes.effects.pressure_friction import PressureFriction
from qlvbayes.effects.second_contact import SecondContact
from qlvbayes.effects.sharp_friction import SharpFriction
from qlvbayes.effects.slow_change import SlowChange
from qlvbayes.effects.spreading_lag import SpreadingLag
from qlvbayes.effects.squeeze_film import SqueezeFilm
from qlvbayes.effects.stiffening_frame import StiffeningFrame
from qlvbayes.effects.strain_dependent_rate import StrainDependentRate
from qlvbayes.effects.strain_dependent_strength import StrainDependentStrength
from qlvbayes.effects.stress_softening import StressSoftening
from qlvbayes.effects.thixotropy import Thixotropy
from qlvbayes.effects.viscous_drag import ViscousDrag
from qlvbayes.io.checks import InputError, check_known
from qlvbayes.io.usermodule import check_own, own_classes

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
    """Return the effects of each family, the listed one first.

    Families come in the order of their first effect.
    """
    families: dict[str, list[type[AbstractEffect]]] = {}
    for kind in kinds:
        families.setdefault(kind.family(), []).append(kind)
    return families


def find(name: str, kinds: Sequence[type[AbstractEffect]] = EVERY) -> type[AbstractEffect]:
    """Return the effect of that name; an InputError lists the known ones otherwise."""
    check_known("effect", name, names(kinds))
    return next(kind for kind in kinds if kind.name == name)


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
