"""Readings that are none: lost, spikes, stuck, clipped, or of a clock that slipped.

What its neighbours on both sides contradict and the other channel does not show is no reading of
the specimen. It is detected before the record is used, in medians and differences of
neighbours alone, O(n), and without a model of the material.
"""

from qlvbayes.motion.badreadings.finding import smooth_readings, sound_tests, without
from qlvbayes.motion.badreadings.outliers import outlying, runs_of
from qlvbayes.motion.badreadings.result import Bad, BadReadings, left_out_notice

__all__ = [
    "Bad",
    "BadReadings",
    "left_out_notice",
    "outlying",
    "runs_of",
    "smooth_readings",
    "sound_tests",
    "without",
]
