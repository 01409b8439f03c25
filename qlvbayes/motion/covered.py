"""Ranges that a pad's tests cover: depths, speeds and times, outside which a model extrapolates."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace

import numpy as np

from qlvbayes.motion.experiment import Experiment, Trial


@dataclass(frozen=True)
class Covered:
    """Ranges of depth, speed and time of one pad's tests."""

    depth: float  # largest depth
    # slowest, fastest: loading rates, in the pad's units
    slowest: float
    fastest: float
    quickest: float  # duration of the shortest ramp (s)
    hold: float  # duration of the longest dwell (s)
    tests: int  # how many

    def as_dict(self) -> dict[str, float]:
        """Return plain values for JSON."""
        return asdict(self)

    def times(self, factor: float) -> Covered:
        """Return the ranges in a unit of displacement that is 1/factor as large."""
        sizes = {name: factor * getattr(self, name) for name in ("depth", "slowest", "fastest")}
        return replace(self, **sizes)


def covered(experiment: Experiment) -> Covered:
    """Return the ranges of a pad's tests; without a dwell ``hold`` is the longest phase."""
    trials = experiment.trials
    phases = [phase for trial in trials for phase in trial.used_phases]
    ramps = [p.stop - p.start for p in phases if p.kind == "ramp"]
    dwells = [p.stop - p.start for p in phases if p.kind in ("hold", "recovery")]
    loading = [trial for trial in trials if not _ramps_left_out(trial)] or trials
    rates = [trial.rate for trial in loading if np.isfinite(trial.rate)]
    return Covered(
        depth=max(float(np.max(trial.test.displacement)) for trial in trials),
        slowest=float(min(rates)),
        fastest=float(max(rates)),
        quickest=float(min(ramps or [p.stop - p.start for p in phases])),
        hold=float(max(dwells or [p.stop - p.start for p in phases])),
        tests=len(trials),
    )


def _ramps_left_out(trial: Trial) -> bool:
    kinds = [{phase.kind for phase in phases} for phases in (trial.phases, trial.used_phases)]
    return "ramp" in kinds[0] - kinds[1]
