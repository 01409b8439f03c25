"""The hidden effects by name."""

from __future__ import annotations

from qlvbayes.io.checks import check_known

from . import contact_effects, pad_effects, sensor_effects
from .effect import Effect


def by_name(*classes: type[Effect]) -> dict[str, type[Effect]]:
    """Return some effects' classes by their names."""
    return {effect.name: effect for effect in classes}


HIDDEN = by_name(
    pad_effects.ExtraRelaxationMode,
    pad_effects.StrainDependentRate,
    pad_effects.StrainDependentStrength,
    pad_effects.StressSoftening,
    pad_effects.FluidLeak,
    pad_effects.Thixotropy,
    pad_effects.Conditioning,
    pad_effects.ViscousDrag,
    pad_effects.PowerLawDrag,
    pad_effects.SqueezeFilm,
    pad_effects.FluidPressure,
    pad_effects.Friction,
    pad_effects.SecondContact,
    contact_effects.InterfaceSlip,
    contact_effects.PermanentSet,
    contact_effects.ContactOffset,
    contact_effects.Backlash,
    contact_effects.Adhesion,
    contact_effects.FrameCompliance,
    sensor_effects.FrameRinging,
    sensor_effects.Inertia,
    sensor_effects.ForceOffset,
    sensor_effects.ForceDrift,
    sensor_effects.LoadCellCreep,
    sensor_effects.ChannelLag,
)
"""The listed effects, from the material to the sensor."""


def effect_class(name: str) -> type[Effect]:
    """Return the class of the effect with this name."""
    check_known("effect", name, HIDDEN)
    return HIDDEN[name]
