"""The names of what may be hidden in a population's pads, now and when earlier runs were made."""

from __future__ import annotations

from dataclasses import dataclass

from blind.catalogue import FOREIGN, FORMS, FURTHER, OUTSIDE
from qlvbayes.simulate import HIDDEN


@dataclass(frozen=True)
class Lists:
    """Names of hidden effects, in the order from which they are drawn.

    Parameters
    ----------
    listed
        Effects of the list.
    forms
        Other forms of listed effects.
    outside
        Effects outside the list.
    """

    listed: tuple[str, ...]
    forms: tuple[str, ...]
    outside: tuple[str, ...]


PRESENT = Lists(
    tuple(name for name, kind in HIDDEN.items() if not kind.slides),
    (*FORMS, *FOREIGN),
    (*OUTSIDE, *FURTHER),
)
"""All that the simulator can hide in a pad that lies loose, as those of the population do."""

FIRST = Lists(
    (
        "extra_relaxation_mode", "strain_dependent_rate", "strain_dependent_strength",
        "stress_softening", "fluid_leak", "viscous_drag", "power_law_drag", "squeeze_film",
        "fluid_pressure", "friction", "permanent_set", "contact_offset", "adhesion",
        "frame_compliance", "inertia", "force_offset", "force_drift", "channel_lag",
    ),
    (
        "stretched_relaxation", "linear_rate", "exponential_softening", "saturating_leak",
        "growing_drag", "steep_squeeze_film", "quadratic_pressure", "coulomb_friction", "toe",
        "bending_frame", "saturating_drift", "channel_low_pass", "cavitating_film",
        "poroelastic_diffusion", "tilted_platen", "root_leak", "one_way_friction",
        "healing_softening",
    ),
    (
        "second_contact", "slip", "temperature_swing", "ringing", "rezeroed", "slow_creep_jump",
        "sensor_nonlinearity", "amplifier_clipping", "viscous_heating", "backlash",
        "drive_ripple", "load_cell_creep", "stick_slip", "snap_through", "thixotropy", "curing",
    ),
)  # fmt: skip
"""Those of the runs whose registration does not say, `bounds` and `beam` of November 2026."""
