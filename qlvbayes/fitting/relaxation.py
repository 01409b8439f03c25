"""Report of each held test what a report of a stress relaxation test has to state.

After ISO 3384-1:2019 and ASTM D6147: the specimen, how it was loaded, the temperature, what it had
gone through before, the initial force, and the share of it that is left at stated times. What the
file of measurements does not hold is said to be not stated.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from qlvbayes.io.arrays import finite_or_none
from qlvbayes.io.data import Control
from qlvbayes.io.files import Part, Result
from qlvbayes.io.units import PAD, UnitSystem
from qlvbayes.io.wording import plain, visible
from qlvbayes.motion.experiment import Experiment, Trial
from qlvbayes.motion.phases import Phase

TIMES = (1.0, 10.0, 100.0, 1000.0)  # s since the end of loading, a decade apart
_INSTANTS = 2000  # of a ramp, at which it is asked whether the specimen is touched
_AROUND = 0.1  # of a stated time, either side: readings that are averaged for it

NOT_TO_EXTRAPOLATE = (
    "Shares are stated for times that were held, and no others: relaxation curves are not to be "
    "extrapolated to times considerably longer than the test, nor to other temperatures."
)
INITIAL = (
    "The initial force is the largest reading at the end of loading. Rubber standards may take it "
    "later (some 30 min after loading): shares of that force are larger than these."
)


class HoldReport(Part, frozen=True, rename={k: f"{k}_s" for k in ("hold", "loading", "at")}):
    """First hold of one test after loading, in the units of the file."""

    test: str
    deformation: float  # that was held
    rate: float | None  # of loading
    loading: float  # how long it took (s)
    initial: float  # largest force
    hold: float  # how long (s)
    # at, left: times since the end of loading (s) and the share of the initial force at each, as
    # far as it was held
    at: tuple[float, ...]
    left: tuple[float, ...]
    history: str  # what the specimen had gone through


class RelaxationReport(Result, frozen=True, kw_only=True):
    """Stress relaxation of one pad, in each test that has a hold: ``relaxation.json``."""

    pad: str
    units: UnitSystem = PAD
    specimen: str  # what the file says of it
    temperature: float | None = None  # None, as files of measurements state none
    tests: tuple[HoldReport, ...]
    warnings: tuple[str, ...] = (INITIAL, NOT_TO_EXTRAPOLATE)

    def text(self) -> str:
        """Return the report for readers: ``relaxation.txt``."""
        units = self.units
        lines = [
            f"Stress relaxation of pad {self.pad} (what ISO 3384-1 and ASTM D6147 ask to state)",
            f"Specimen: {self.specimen}",
            "Temperature: not stated in the file of measurements",
        ]
        length = "" if units.dimensionless else f" {units.displacement}"
        for one in self.tests:
            rate = "" if one.rate is None else f" at {plain(one.rate)} {units.speed}"
            shares = (f"{t:g} s: {x:.1%}" for t, x in zip(one.at, one.left, strict=True))
            lines += [
                f"Test {one.test}: {units.displacement_name} {one.deformation:.4g}{length}"
                f"{rate}, in {plain(one.loading)} s; held {one.hold:.4g} s; {one.history}",
                f"  initial {units.force_name} {one.initial:.4g} {units.force}; left after "
                + (", ".join(shares) or f"{TIMES[0]:g} s: not held so long"),
            ]
        return "\n".join(map(visible, [*lines, *self.warnings])) + "\n"


def relaxation_report(experiment: Experiment) -> RelaxationReport | None:
    """Return the report of all tests whose displacement was held after loading, or None."""
    reports = (_hold_report(experiment, trial) for trial in experiment.trials)
    tests = tuple(report for report in reports if report is not None)
    fluid = f"filled with {experiment.fluid}; " if experiment.fluid else ""
    specimen = f"{fluid}shape, size and preparation not stated in the file of measurements"
    pad, units = experiment.pad, experiment.units
    return RelaxationReport(pad=pad, units=units, specimen=specimen, tests=tests) if tests else None


def _hold_report(experiment: Experiment, trial: Trial) -> HoldReport | None:
    """Return the report of the first hold of a displacement after a ramp; None without one."""
    for ramp, hold in pairwise(trial.phases):
        held = hold.control == Control.DISPLACEMENT
        if held and (ramp.kind, hold.kind) == ("ramp", "hold"):
            break
    else:
        return None
    if hold not in trial.used_phases:
        return None
    time, force = trial.test.time, trial.test.force
    # a reading's width beyond, for the kink is not known better
    width = 2.0 * float(np.median(np.diff(time)[:200]))
    loaded = force[(time >= ramp.start) & (time <= hold.start + width)]
    since = time - hold.start
    nearest = float(np.min(np.abs(trial.whole.time - hold.start)))
    initial = float(np.max(loaded, initial=0.0))
    # the end of loading may be left out
    if np.min(np.abs(since)) > max(width, nearest) or initial <= 0.0:
        return None
    at, left = [], []
    for moment in TIMES:
        near = force[np.abs(since - moment) <= _AROUND * moment]
        if moment * (1.0 + _AROUND) <= hold.stop - hold.start and near.size:
            at.append(moment)
            left.append(float(np.mean(near)) / initial)
    return HoldReport(
        test=trial.name, deformation=float(trial.trajectory.displacement(hold.start)),
        rate=finite_or_none(trial.rate), loading=ramp.stop - _touched(trial, ramp), initial=initial,
        hold=hold.stop - hold.start, at=tuple(at), left=tuple(left),
        history=_history(experiment, trial),
    )  # fmt: skip


def _touched(trial: Trial, ramp: Phase) -> float:
    """Return when a ramp loads the specimen (s): neither a rest does, nor a way through air."""
    path, near = trial.trajectory, 2.0 * trial.trajectory.resolution
    every = np.linspace(ramp.start, ramp.stop, _INSTANTS)
    way = path.displacement(every)
    off = np.flatnonzero(way <= max(-near, float(way[0]) + near))
    return float(every[off[-1]]) if off.size else ramp.start


def _history(experiment: Experiment, trial: Trial) -> str:
    before = experiment.tests_before(trial)
    if not before:
        return "the specimen's first test in the file"
    test = trial.whole
    earlier = [t.whole for t in experiment.trials if t.whole.start_s < test.start_s]
    last = max(earlier, key=lambda t: t.start_s)
    tests = "1 test" if before == 1 else f"{before} tests"
    if not test.start_known:
        return f"after {tests}, at a time that the file does not state"
    rest = test.start_s + float(test.time[0]) - last.start_s - float(last.time[-1])
    return f"after {tests}, {plain(rest)} s after the last one's end"
