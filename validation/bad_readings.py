"""Are bad readings found, and sound ones kept? Writes a section of a page.

Pads of the wide population and of the paper's protocols are simulated (kept in build/validation, so
that a second run needs seconds). In each as it is, whatever is left out is a false alarm; then one
test of it is spoiled in each way of `SPOILED` in turn, and what is found is compared.
"""

from __future__ import annotations

import argparse
import pickle
import shlex
import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from coverage import progress
from page import Origin

from qlvbayes.evaluation.population import Population
from qlvbayes.evaluation.study import measured
from qlvbayes.evaluation.wide import make_wide
from qlvbayes.io.checks import InputError
from qlvbayes.io.data import Pad, Test, read_measurements
from qlvbayes.io.files import write_whole
from qlvbayes.preprocess.badreadings import sound_tests
from qlvbayes.simulate import (
    NOISES,
    TABLE_1,
    HiddenPad,
    cyclic,
    paper_protocol,
    record_study,
    sine,
)

ROOT = Path(__file__).resolve().parents[1]
_LARGE = 0.2  # of a channel's range: a lost reading that moves by less is no loss
_AWAY = 5  # readings from either end, but where the ends themselves are spoiled
_CLIPPED = 0.9  # of the largest force

Spoiled = tuple[Test, np.ndarray]
Spoil = Callable[[Test, np.random.Generator], Spoiled | None]
