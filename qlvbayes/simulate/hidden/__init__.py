"""Pads with physical effects that no parameter of the quasi-linear law describes.

The effects change the depth on its way in and the force on its way out, from the material through
pad, contact and frame to the sensor; see `HiddenPad`.
"""

from .catalogue import FOREIGN, FORMS, FURTHER, HIDDEN, OUTSIDE, effect_class
from .contact_effects import Adhesion, ContactOffset, FrameCompliance, NearContact, PermanentSet
from .draw import draw_effect, draw_effect_in
from .effect import Effect
from .forms import (
    BendingFrame,
    ChannelLowPass,
    CoulombFriction,
    ExponentialSoftening,
    GrowingDrag,
    LinearRate,
    QuadraticPressure,
    SaturatingDrift,
    SaturatingLeak,
    SteepSqueezeFilm,
    StretchedRelaxation,
    Toe,
)
from .outside import (
    AmplifierClipping,
    Rezeroed,
    Ringing,
    SensorNonlinearity,
    Slip,
    SlowCreepJump,
    TemperatureSwing,
)
from .pad import HiddenPad
from .pad_effects import (
    ExtraRelaxationMode,
    FluidLeak,
    FluidPressure,
    Friction,
    PowerLawDrag,
    SecondContact,
    SqueezeFilm,
    StrainDependentRate,
    StrainDependentStrength,
    StressSoftening,
    ViscousDrag,
)
from .parse import parse_effect
from .sensor_effects import ChannelLag, ForceDrift, ForceOffset, Inertia

__all__ = [
    "FOREIGN",
    "FORMS",
    "FURTHER",
    "HIDDEN",
    "OUTSIDE",
    "Adhesion",
    "AmplifierClipping",
    "BendingFrame",
    "ChannelLag",
    "ChannelLowPass",
    "ContactOffset",
    "CoulombFriction",
    "Effect",
    "ExponentialSoftening",
    "ExtraRelaxationMode",
    "FluidLeak",
    "FluidPressure",
    "ForceDrift",
    "ForceOffset",
    "FrameCompliance",
    "Friction",
    "GrowingDrag",
    "HiddenPad",
    "Inertia",
    "LinearRate",
    "NearContact",
    "PermanentSet",
    "PowerLawDrag",
    "QuadraticPressure",
    "Rezeroed",
    "Ringing",
    "SaturatingDrift",
    "SaturatingLeak",
    "SecondContact",
    "SensorNonlinearity",
    "Slip",
    "SlowCreepJump",
    "SqueezeFilm",
    "SteepSqueezeFilm",
    "StrainDependentRate",
    "StrainDependentStrength",
    "StressSoftening",
    "StretchedRelaxation",
    "TemperatureSwing",
    "Toe",
    "ViscousDrag",
    "draw_effect",
    "draw_effect_in",
    "effect_class",
    "parse_effect",
]
