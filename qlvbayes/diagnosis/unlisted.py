"""Rivals that no list holds: where one explains the tests better, what was found only imitates."""

from __future__ import annotations

import math

import numpy as np

from qlvbayes.diagnosis.freeoffsets import FreeOffsets
from qlvbayes.diagnosis.freespring import FreeSpring, KinkedSpring
from qlvbayes.experiment import Experiment
from qlvbayes.inference.gaussnewton import Point
from qlvbayes.inference.subset import Ensemble

UNLISTED = {"free_spring": (FreeSpring, KinkedSpring), "free_offsets": (FreeOffsets,)}
_HOPELESS = 30.0  # log evidence behind, from which the next kind will not help either


def against_unlisted(
    experiment: Experiment, ensemble: Ensemble, plain: Point, found: float
) -> dict[str, float]:
    """Log Bayes factor of each rival against a log evidence found; its kinds are equally likely.

    Climbs that cannot reach it are given up, and kinds after one that is far behind.
    """
    subset, gains = ensemble.subset(), {}
    for name, kinds in UNLISTED.items():
        tops: list[float] = []
        for kind in kinds:
            if not tops or tops[-1] > found - _HOPELESS:
                top = kind(experiment, ensemble, subset).highest(plain, found)
                tops.append(float(top.log_evidence))
        gains[name] = float(np.logaddexp.reduce(tops)) - math.log(len(kinds)) - found
    return gains
