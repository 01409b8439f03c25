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


def against_unlisted(
    experiment: Experiment, ensemble: Ensemble, plain: Point, found: float
) -> dict[str, float]:
    """Log Bayes factor of each rival against a log evidence found; its kinds are equally likely.

    Climbs that cannot reach it are given up.
    """
    subset, gains = ensemble.subset(), {}
    for name, kinds in UNLISTED.items():
        tops = [kind(experiment, ensemble, subset).highest(plain, found) for kind in kinds]
        gains[name] = float(_mean([top.log_evidence for top in tops]) - found)
    return gains


def _mean(logs: list[float]) -> float:
    return float(np.logaddexp.reduce(logs)) - math.log(len(logs))
