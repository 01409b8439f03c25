"""Suggestions: the best further tests to separate explanations.

The computation is that of ``qlvbayes design`` (`series`), with fewer designs.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from qlvbayes.diagnosis.candidate import Candidate, described
from qlvbayes.diagnosis.nexttest.belief import Belief
from qlvbayes.diagnosis.nexttest.design import Design, Rig, draw_designs
from qlvbayes.diagnosis.nexttest.explanations import explanation_of_mode
from qlvbayes.diagnosis.nexttest.information import TOGETHER, evidence, screen
from qlvbayes.diagnosis.nexttest.records import ReadingErrors
from qlvbayes.diagnosis.prior import Families
from qlvbayes.diagnosis.result import Suggestion
from qlvbayes.inference.density import Density
from qlvbayes.motion.experiment import Experiment

NOTHING = "no effect"
UNLISTED = "something unlisted"
"""Causes that are not the name of an effect."""
_LONGEST = 600.0  # s, with the pause before the test: the default of 'qlvbayes design'
_SUGGESTED = 5  # tests


def suggest(
    experiment: Experiment, density: Density, candidates: Sequence[Candidate]
) -> list[Suggestion]:
    """Return the tests that best separate some candidates, the best first."""
    rig, belief = Rig.from_tests(experiment), equal_belief(density, candidates)
    designs = draw_designs(rig, belief.recovery, _LONGEST, TOGETHER, 0)
    if not designs:
        return []
    missed = max(one.mode.size for one in candidates)
    worth = expected_evidence(experiment, rig, belief, designs, missed)
    order = np.argsort(-worth, kind="stable")[:_SUGGESTED]
    units = experiment.units
    return [Suggestion(designs[k].words(units), float(worth[k])) for k in order]


def equal_belief(density: Density, candidates: Sequence[Candidate]) -> Belief:
    """Return a belief in which all candidates are equally probable."""
    ordered = sorted(candidates, key=lambda one: described(one.hypothesis))
    return Belief.from_explanations([explanation_of_mode(density, one, 1.0) for one in ordered])


def expected_evidence(
    experiment: Experiment, rig: Rig, belief: Belief, designs: Sequence[Design], missed: float
) -> np.ndarray:
    """Return the expected 2 ln(Bayes factor) (T,) between the nearest explanations by each test."""
    scales = experiment.scales
    errors = ReadingErrors(experiment.floor, scales.force, missed)
    return evidence(screen(belief, designs, rig, errors, scales.clock)[0])


def cause_of(effects: Collection[str], families: Families) -> str:
    """Return the cause that a set of effects stands for: their families, in words."""
    listed = [name for name in effects if name not in families.unmodelled]
    names = sorted({families.family_of.get(name, name) for name in listed})
    unlisted = [UNLISTED] if len(listed) < len(effects) else []
    return " + ".join((*names, *unlisted)) or NOTHING
