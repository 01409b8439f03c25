"""Define physical effects that a model may lack, one effect a file.

The folder offers a class for each effect, lists of them, and what a user's own effect is made of
and checked by.
"""

from qlvbayes.effects.adhesion import Adhesion
from qlvbayes.effects.backlash import Backlash
from qlvbayes.effects.catalogue import EFFECTS, EVERY, FORMS, OUTSIDE
from qlvbayes.effects.channel_lag import ChannelLag
from qlvbayes.effects.conditioning import Conditioning
from qlvbayes.effects.conformance import check_effect, effect_checks
from qlvbayes.effects.contact_offset import ContactOffset
from qlvbayes.effects.effect import AbstractEffect, Level
from qlvbayes.effects.extra_relaxation_mode import ExtraRelaxationMode
from qlvbayes.effects.fluid_leak import FluidLeak
from qlvbayes.effects.fluid_pressure import FluidPressure
from qlvbayes.effects.force_drift import ForceDrift
from qlvbayes.effects.force_offset import ForceOffset
from qlvbayes.effects.frame_compliance import FrameCompliance
from qlvbayes.effects.friction import Friction
from qlvbayes.effects.gradual_contact import GradualContact
from qlvbayes.effects.inertia import Inertia
from qlvbayes.effects.levelling_drift import LevellingDrift
from qlvbayes.effects.levelling_leak import LevellingLeak
from qlvbayes.effects.load_cell_creep import LoadCellCreep
from qlvbayes.effects.offsets_by_test import OffsetsByTest
from qlvbayes.effects.permanent_set import PermanentSet
from qlvbayes.effects.power_law_drag import PowerLawDrag
from qlvbayes.effects.power_law_drainage import PowerLawDrainage
from qlvbayes.effects.pressure_friction import PressureFriction
from qlvbayes.effects.second_contact import SecondContact
from qlvbayes.effects.slow_change import SlowChange
from qlvbayes.effects.spreading_lag import SpreadingLag
from qlvbayes.effects.squeeze_film import SqueezeFilm
from qlvbayes.effects.stiffening_frame import StiffeningFrame
from qlvbayes.effects.strain_dependent_rate import StrainDependentRate
from qlvbayes.effects.strain_dependent_strength import StrainDependentStrength
from qlvbayes.effects.stress_softening import StressSoftening
from qlvbayes.effects.thixotropy import Thixotropy
from qlvbayes.effects.viscous_drag import ViscousDrag

__all__ = [
    "EFFECTS",
    "EVERY",
    "FORMS",
    "OUTSIDE",
    "AbstractEffect",
    "Adhesion",
    "Backlash",
    "ChannelLag",
    "Conditioning",
    "ContactOffset",
    "ExtraRelaxationMode",
    "FluidLeak",
    "FluidPressure",
    "ForceDrift",
    "ForceOffset",
    "FrameCompliance",
    "Friction",
    "GradualContact",
    "Inertia",
    "Level",
    "LevellingDrift",
    "LevellingLeak",
    "LoadCellCreep",
    "OffsetsByTest",
    "PermanentSet",
    "PowerLawDrag",
    "PowerLawDrainage",
    "PressureFriction",
    "SecondContact",
    "SlowChange",
    "SpreadingLag",
    "SqueezeFilm",
    "StiffeningFrame",
    "StrainDependentRate",
    "StrainDependentStrength",
    "StressSoftening",
    "Thixotropy",
    "ViscousDrag",
    "check_effect",
    "effect_checks",
]
