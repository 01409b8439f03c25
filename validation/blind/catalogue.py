"""List what a blind study may hide beyond the listed effects: other forms, and outsiders."""

from __future__ import annotations

from blind import foreign, forms, further, guide, outside
from qlvbayes.simulate import HIDDEN, Effect
from qlvbayes.simulate.hidden.catalogue import by_name

FORMS = by_name(
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

OUTSIDE = by_name(
    outside.Slip,
    outside.TemperatureSwing,
    outside.Rezeroed,
    outside.SlowCreepJump,
    outside.SensorNonlinearity,
    outside.AmplifierClipping,
)
"""Effects that no entry of the list explains."""


FOREIGN = by_name(
    foreign.CavitatingFilm,
    foreign.PoroelasticDiffusion,
    foreign.TiltedPlaten,
    foreign.RootLeak,
    foreign.OneWayFriction,
    foreign.HealingSoftening,
    outside.Ringing,
)
"""Forms of listed effects that no form of the diagnosis was written with in view."""

FURTHER = by_name(
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

KINDS: dict[str, type[Effect]] = {**HIDDEN, **FORMS, **OUTSIDE, **FOREIGN, **FURTHER}
"""All of them, the listed ones too."""
