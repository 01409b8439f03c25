"""Which further test would tell explanations apart: the best of some that the rig can do.

The engine is that of ``qlvbayes design`` (`nexttest`), with fewer tests and the closed form alone.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from qlvbayes.diagnosis.candidate import Candidate, described
from qlvbayes.diagnosis.nexttest.belief import Belief, normalised
from qlvbayes.diagnosis.nexttest.design import Design, drawn
from qlvbayes.diagnosis.nexttest.errors import Errors
from qlvbayes.diagnosis.nexttest.hypotheses import explanation_of_mode
from qlvbayes.diagnosis.nexttest.information import evidence
from qlvbayes.diagnosis.nexttest.rig import Rig
from qlvbayes.diagnosis.nexttest.screening import TOGETHER, screened
from qlvbayes.diagnosis.prior import Families
from qlvbayes.diagnosis.result import Suggestion
from qlvbayes.inference.density import Density
from qlvbayes.preprocess.experiment import Experiment

NOTHING = "no effect"
UNLISTED = "something unlisted"
"""Causes that no effect's name tells."""
_LONGEST = 600.0  # s, with the pause before it: what 'design' takes for granted
_TOLD = 5


def suggest(
    experiment: Experiment, density: Density, found: Sequence[Candidate]
) -> list[Suggestion]:
    """The best tests, best first; the evidence is that between the two nearest explanations."""
    rig, belief = Rig.of_tests(experiment), believed(density, found)
    designs = drawn(rig, belief.recovery, _LONGEST, TOGETHER, 0)
    worth = promised(experiment, rig, belief, designs, max(one.mode.size for one in found))
    order = np.argsort(-worth, kind="stable")[:_TOLD]
    units = experiment.units
    return [Suggestion(designs[k].words(units), float(worth[k])) for k in order]


def believed(density: Density, found: Sequence[Candidate]) -> Belief:
    """Explanations that are equally likely, in an order that is always the same."""
    ordered = sorted(found, key=lambda one: described(one.hypothesis))
    return normalised(
        [
            explanation_of_mode(
                density,
                one.hypothesis,
                one.point,
                one.evidence.covariance,
                one.mode.size,
                1.0,
                described(one.hypothesis),
            )
            for one in ordered
        ]
    )


def promised(
    experiment: Experiment, rig: Rig, belief: Belief, designs: Sequence[Design], missed: float
) -> np.ndarray:
    """Expected 2 ln Bayes factor (T,) by each test alone; missed: by the explanations (N)."""
    scales = experiment.scales
    errors = Errors(experiment.floor, scales.force, missed)
    return evidence(screened(belief, designs, rig, errors, scales.clock)[0])


def cause_of(effects: Collection[str], families: Families) -> str:
    """What a set of effects is told by: their families, whatever form and laws they have."""
    listed = [name for name in effects if name not in families.unmodelled]
    names = sorted({families.family_of.get(name, name) for name in listed})
    unlisted = [UNLISTED] if len(listed) < len(effects) else []
    return " + ".join((*names, *unlisted)) or NOTHING
