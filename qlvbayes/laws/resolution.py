"""Name relaxation times that the tests do not resolve, so that their prior decides about them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from qlvbayes.laws.relaxation.law import AbstractRelaxation
from qlvbayes.laws.scales import Scales


def unresolved_times(relaxation: AbstractRelaxation, scales: Scales) -> Iterator[str]:
    """Yield a sentence for each time below the sampling interval or beyond the longest phase.

    The constants of ``relaxation`` must be numbers.
    """
    for name, time in relaxation.times().items():
        value = float(np.asarray(time))
        if value < scales.shortest:
            yield (
                f"{name} is about {value:.2g} s, below the sampling interval of "
                f"{scales.shortest:.2g} s: its prior says more of it than the tests"
            )
        if value > scales.longest:
            yield (
                f"{name} is about {value:.2g} s, beyond the longest hold of "
                f"{scales.longest:.2g} s: its prior says more of it than the tests"
            )
