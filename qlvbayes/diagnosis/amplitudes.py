"""The priors of the effects' amplitudes, scaled so that all effects have the same prior force."""

from __future__ import annotations

import math

import numpy as np

from qlvbayes.diagnosis.prior import Families
from qlvbayes.diagnosis.settings import DiagnosisSettings
from qlvbayes.inference.density import Density, Point
from qlvbayes.inference.forward.hypothesis import Hypothesis
from qlvbayes.inference.forward.space import in_natural_amplitude
from qlvbayes.inference.starts import amplitude_of, shapes
from qlvbayes.laws.scales import SHARE


def scale_amplitudes(
    density: Density,
    baseline: Hypothesis,
    point: Point,
    families: Families,
    settings: DiagnosisSettings,
) -> Density:
    """Return a density in which one prior sd of any effect adds 5 % of the largest force."""
    space, signatures, factors = density.space, [], {}
    peak = density.discrepancy.peak
    for name in families.nameable:
        hypothesis = baseline.plus(name)
        own = space.parameters(hypothesis)
        amplitude = amplitude_of(own, name)
        if name in baseline.effects or amplitude is None:  # the user gave it a prior
            continue
        starts = shapes(space, point, own, name)
        for start in dict.fromkeys(map(tuple, (starts[0], starts[-1]))):
            added = space.added_force(hypothesis, np.array(start), amplitude.number, amplitude.sd)
            largest = float(np.max(np.abs(added[space.real])))
            if largest > 0.0 and math.isfinite(largest):
                signatures.append(added / largest)
                factors[name] = float(
                    np.clip(SHARE * peak / largest, settings.narrowest, settings.widest)
                )
    # a form holds the candidate's law inside, with the same amplitude
    effects = {
        name: in_natural_amplitude(effect, factors[families.family_of[name]])
        for name, effect in space.effects.items()
        if families.family_of[name] in factors
    }
    return density.with_space(space.with_effects({**space.effects, **effects}), signatures)
