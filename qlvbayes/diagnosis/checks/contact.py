"""Compare a contact offset that a diagnosis names to the contact that was measured."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from qlvbayes.diagnosis.result import Estimate
from qlvbayes.effects.catalogue import by_family
from qlvbayes.effects.contacts import ContactOffset
from qlvbayes.io.wording import plain
from qlvbayes.motion.experiment import Experiment

_BEYOND = 2.0  # standard errors of both together


def is_gap(constant: str) -> bool:
    """Return whether a constant, such as ``contact_offset.gap``, is where contact begins."""
    effect, _, name = constant.partition(".")
    kinds = by_family().get(ContactOffset.name, [])
    return name == "gap" and effect in [kind.name for kind in kinds]


def contact_error(experiment: Experiment) -> float | None:
    """Return the standard error of the contact of all tests together; None if none was measured."""
    tests = [trial.test for trial in experiment.trials if trial.test.contact_sd]
    own = {test.contact_stage or str(k): test.contact_sd for k, test in enumerate(tests)}
    sds = np.array([sd for sd in own.values() if sd])
    return float(np.sum(sds**-2.0) ** -0.5) if sds.size else None


def contact_notices(experiment: Experiment, estimates: Mapping[str, Estimate]) -> tuple[str, ...]:
    """Return a sentence if a contact offset lies beyond the error of the measured contact."""
    error = contact_error(experiment)
    return tuple(
        f"pad {experiment.pad}: {name.removesuffix('.gap')} of {gap} contradicts the measured "
        f"contact, which is known to {plain(error, 2)} {gap.unit}. One of the two is wrong: "
        "another effect looks like an offset, or drag, a film or a lag has moved the measured "
        "onset of the force. The option --contact states a contact where a machine's file is read"
        for name, gap in estimates.items()
        if is_gap(name) and error is not None and abs(gap.mean) > _BEYOND * np.hypot(gap.sd, error)
    )
