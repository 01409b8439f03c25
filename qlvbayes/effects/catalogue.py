"""Every effect that comes with the package, in the order in which they are listed."""

from __future__ import annotations

from collections.abc import Sequence

from qlvbayes.checks import InputError
from qlvbayes.effects.adhesion import Adhesion
from qlvbayes.effects.channel_lag import ChannelLag
from qlvbayes.effects.contact_offset import ContactOffset
from qlvbayes.effects.effect import AbstractEffect
from qlvbayes.effects.extra_relaxation_mode import ExtraRelaxationMode
from qlvbayes.effects.fluid_leak import FluidLeak
from qlvbayes.effects.fluid_pressure import FluidPressure
from qlvbayes.effects.force_drift import ForceDrift
from qlvbayes.effects.force_offset import ForceOffset
from qlvbayes.effects.frame_compliance import FrameCompliance
from qlvbayes.effects.friction import Friction
from qlvbayes.effects.inertia import Inertia
from qlvbayes.effects.permanent_set import PermanentSet
from qlvbayes.effects.power_law_drag import PowerLawDrag
from qlvbayes.effects.squeeze_film import SqueezeFilm
from qlvbayes.effects.strain_dependent_rate import StrainDependentRate
from qlvbayes.effects.strain_dependent_strength import StrainDependentStrength
from qlvbayes.effects.stress_softening import StressSoftening
from qlvbayes.effects.viscous_drag import ViscousDrag

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
    Friction,
    PermanentSet,
    ContactOffset,
    Adhesion,
    FrameCompliance,
    Inertia,
    ForceOffset,
    ForceDrift,
    ChannelLag,
)
"""Every effect that comes with the package."""


def names(kinds: Sequence[type[AbstractEffect]] = EFFECTS) -> tuple[str, ...]:
    """The effects' names, as on the command line."""
    return tuple(kind.name for kind in kinds)


def find(name: str, kinds: Sequence[type[AbstractEffect]] = EFFECTS) -> type[AbstractEffect]:
    """The effect of that name; InputError lists the known ones otherwise."""
    for kind in kinds:
        if kind.name == name:
            return kind
    known = ", ".join(names(kinds))
    raise InputError(f"no effect {name!r}", remedy=f"use one of {known}")
