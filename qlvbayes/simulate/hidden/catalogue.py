"""The hidden effects by name."""

from __future__ import annotations

from qlvbayes.io.checks import InputError

from . import (
    contact_effects,
    foreign,
    forms,
    further,
    guide,
    outside,
    pad_effects,
    sensor_effects,
)
from .effect import Effect


def _by_name(*classes: type[Effect]) -> dict[str, type[Effect]]:
    return {effect.name: effect for effect in classes}


HIDDEN = _by_name(
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

FORMS = _by_name(
    forms.StretchedRelaxation,
    forms.LinearRate,
    forms.ExponentialSoftening,
    forms.SaturatingLeak,
    forms.GrowingDrag,
    forms.SteepSqueezeFilm,
    forms.QuadraticPressure,
    forms.CoulombFriction,
    forms.Toe,
    forms.BendingFrame,
    forms.SaturatingDrift,
    forms.ChannelLowPass,
    forms.AdhesionAtAStretch,
    guide.GuideFriction,
    guide.GuideDrag,
)
"""Other forms of the listed effects; `family` names which."""

OUTSIDE = _by_name(
    outside.Slip,
    outside.TemperatureSwing,
    outside.Rezeroed,
    outside.SlowCreepJump,
    outside.SensorNonlinearity,
    outside.AmplifierClipping,
)
"""Effects that no entry of the list explains."""


FOREIGN = _by_name(
    foreign.CavitatingFilm,
    foreign.PoroelasticDiffusion,
    foreign.TiltedPlaten,
    foreign.RootLeak,
    foreign.OneWayFriction,
    foreign.HealingSoftening,
    outside.Ringing,
)
"""Forms of listed effects that no form of the diagnosis was written with in view."""

FURTHER = _by_name(
    further.ViscousHeating,
    further.DriveRipple,
    further.StickSlip,
    further.SnapThrough,
    further.Curing,
    further.Bubble,
    further.MainsHum,
    further.CrackingSkin,
    further.RollingSpecimen,
    further.Swelling,
    further.DriveWarmth,
)
"""Effects outside the list that nothing of the package stands for."""


def effect_class(name: str) -> type[Effect]:
    """Return the class of the effect with this name, of any kind.

    Raises
    ------
    InputError
        There is none.
    """
    known = {**HIDDEN, **FORMS, **OUTSIDE, **FOREIGN, **FURTHER}
    if name not in known:
        raise InputError(f"no effect '{name}'", remedy=f"use one of {', '.join(known)}")
    return known[name]
