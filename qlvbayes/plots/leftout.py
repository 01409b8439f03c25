"""Draw readings that were left out, as grey crosses in the panels of a test's force."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from qlvbayes.motion.experiment import Trial
from qlvbayes.plots.stretches import PhaseSamples, panel_times

GREY = "#7f7f7f"
LABEL = "left out"
_LARGE = 4.5  # points: larger than a dot, which may lie under the cross


def mark_left_out(
    panels: Sequence[Axes], columns: Sequence[str], trial: Trial, stretches: Sequence[PhaseSamples]
) -> None:
    """Draw a test's left-out readings over its panels, which share their force axis.

    Readings beyond the axis, such as spikes, are drawn at its edge, so that the axis is kept.
    """
    bad = trial.left_out
    if bad is None:
        return
    low, high = panels[0].get_ylim()
    force = np.clip(bad.force, low, high)
    for axis, column in zip(panels, columns, strict=True):
        time = panel_times(column, bad.time, trial.phases, stretches)
        shown = np.isfinite(time)
        if not shown.any() or not axis.lines:
            continue
        axis.plot(
            time[shown], force[shown], "x", color=GREY, markersize=_LARGE, markeredgewidth=0.9,
            clip_on=False, label=LABEL, gid=LABEL,
        )  # fmt: skip
    panels[0].set_ylim(low, high)
