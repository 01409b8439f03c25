"""A pad's tests prepared for a fit: motion, phases, rates, roles and the noise floor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from qlvbayes.io.data import Control, Pad, Test
from qlvbayes.io.units import UnitSystem
from qlvbayes.io.wording import joined, plain
from qlvbayes.motion.approach import without_slopes
from qlvbayes.motion.clean import (
    Reasons,
    UnusedReadings,
    left_out_notice,
    smooth_readings,
    sound_tests,
    without,
)
from qlvbayes.motion.control import controls_of, phases_of, with_both_errors
from qlvbayes.motion.falling import fall_notice, falls_of, largest_force, largest_stiffness
from qlvbayes.motion.noisefloor import NoiseFloor, measure
from qlvbayes.motion.noisefloor.fading import with_fading_sd
from qlvbayes.motion.pad import cut, excluded_notices, excluded_readings, parts_of
from qlvbayes.motion.past import EarlierMotion, past_of
from qlvbayes.motion.phases import Phase, loading_rate, no_ramp, phase_index
from qlvbayes.motion.polling import fresh_forces, held_notices, with_fresh, with_own_readings
from qlvbayes.motion.sensor import encoder_steps, known_scatter
from qlvbayes.motion.trajectory import Trajectory, smooth

if TYPE_CHECKING:  # records and priors are JAX's, which takes longer to load than a first look does
    from qlvbayes.laws.scales import Scales
    from qlvbayes.motion.record import Record
    from qlvbayes.motion.reduction import Fineness

FIT_RATE = 20.0  # mm/s (or 1/s of a strain), the paper's identification test
_CHORD_SHARE = 0.1  # of the noise, that the grid's straight lines may add


@dataclass(frozen=True)
class Trial:
    """A test with its motion and phases; ``rate`` is the loading rate, displacement over s.

    phases are those of the force where that was prescribed; left_out: the readings that ``test``
    no longer has, bad ones and those that the user leaves out; None where there are none; recorded:
    the test with the latter, whose displacement counts; None where there are none.
    """

    test: Test
    trajectory: Trajectory
    phases: tuple[Phase, ...]
    rate: float
    role: str
    left_out: UnusedReadings | None = None
    recorded: Test | None = None

    @property
    def whole(self) -> Test:
        """Test with all sound readings of its displacement, also where their force is left out."""
        return self.recorded or self.test

    @property
    def used_phases(self) -> tuple[Phase, ...]:
        """Phases without those whose every reading of force the user leaves out."""
        read, used = (phase_index(self.phases, test.time) for test in (self.whole, self.test))
        gone = np.setdiff1d(read, used)
        return tuple(phase for k, phase in enumerate(self.phases) if k not in gone)

    @property
    def name(self) -> str:
        """Name of the test."""
        return self.test.name

    @property
    def control(self) -> Control | None:
        """Quantity prescribed throughout the test; None where it changes within the test."""
        controls = {phase.control for phase in self.phases}
        return controls.pop() if len(controls) == 1 else None

    @property
    def approached(self) -> bool:
        """True if a record that begins in motion was preceded by an approach from zero."""
        return self.phases[0].control == Control.DISPLACEMENT

    @property
    def first_ramp(self) -> Phase | None:
        """First loading, of either prescribed quantity; None where there is none."""
        return next((phase for phase in self.phases if phase.kind == "ramp"), None)

    def rows(self, start: float, stop: float) -> NDArray[np.intp]:
        """Return the indices of the readings from a time to another."""
        return np.arange(*np.searchsorted(self.test.time, [start, stop]))

    def phase_of(self, time: np.ndarray) -> np.ndarray:
        """Return the kind of phase (N,) at each time."""
        return np.array([phase.kind for phase in self.phases])[phase_index(self.phases, time)]


@dataclass(frozen=True)
class Experiment:
    """Tests of one pad, prepared for a fit: motion, phases, rates, roles and the noise floor.

    pad: Name of the pad; units: Units of displacement and force of all tests; trials: Every test
    with its motion, phases, loading rate and role, in the order of the file; floor: Noise floor of
    the force, measured without the model; fluid: What fills the pad; None where that is not known;
    rested: Whether every test is taken to begin at rest, whatever came before it; cuts: One
    sentence on each test of which only a part is used, or whose displacement was read more seldom
    than its force; mass: Moving mass that starts and stops show (`evidence.with_mass`), and its sd.
    """

    pad: str
    units: UnitSystem
    trials: tuple[Trial, ...]
    floor: NoiseFloor
    fluid: str | None = None
    rested: bool = False
    cuts: tuple[str, ...] = ()
    mass: tuple[float, float] | None = None

    @cached_property
    def fineness(self) -> Fineness:
        """Fineness with which records are to be reduced, given the noise.

        Straight lines may make a tenth of what the noise changes by between two readings.
        """
        from qlvbayes.motion.reduction import Fineness

        floor, scales = self.floor, self.scales
        change = np.sqrt(2.0 * -np.expm1(-scales.shortest / floor.tau))
        sudden = float(np.hypot(floor.white, floor.ou * change))
        return Fineness(floor, scales.stiffness, _CHORD_SHARE * sudden / scales.stiffness)

    @property
    def notices(self) -> tuple[str, ...]:
        """Sentences on the readings that a user should know of.

        Those left out, those from which the fitted motion is far, where the force falls while the
        platen moves in, and what was prescribed.
        """
        left_out = [(trial.test, trial.left_out) for trial in self.trials]
        off = [(trial.name, trial.trajectory.departure) for trial in self.trials]
        unit = self.units.displacement
        return (
            *self.cuts,
            *excluded_notices(self.pad, left_out, self.units),
            *left_out_notice(self.pad, left_out, self.units),
            *(f"pad {self.pad}: {one.notice(name, unit)}" for name, one in off if one),
            *self.falls,
            *self._load_controlled,
        )

    @cached_property  # a look asks for them by themselves and among all notices
    def falls(self) -> tuple[str, ...]:
        """Sentences on the tests whose force falls while the platen moves in."""
        every = [(t.name, falls_of(t.test, t.trajectory, t.phases)) for t in self.trials]
        return tuple(fall_notice(self.pad, name, some, self.units) for name, some in every if some)

    @property
    def _load_controlled(self) -> tuple[str, ...]:
        """A sentence on the tests in which a prescribed force was detected, if there are any."""
        loaded = []
        for trial in self.trials:
            runs = [list(run) for _, run in groupby(trial.phases, key=lambda one: one.control)]
            held = [run for run in runs if run[0].control == Control.FORCE]
            times = [f"{plain(run[0].start)} to {plain(run[-1].stop)} s" for run in held]
            if held and not trial.test.states_control:
                loaded.append(trial.name + (f" ({joined(times)})" if len(runs) > 1 else ""))
        if not loaded:
            return ()
        those = f"test{'s' if len(loaded) > 1 else ''} {joined(loaded)}"
        return (
            f"pad {self.pad}: in {those} the force is held while the displacement creeps, which is "
            "taken as a prescribed force; a column control (displacement or force in each row) "
            "says otherwise",
        )

    def with_role(self, role: str) -> tuple[Trial, ...]:
        """Return the trials that are fitted, or those that validate."""
        return tuple(trial for trial in self.trials if trial.role == role)

    @property
    def sd_scale(self) -> float:
        """Root mean square of the measured sds over the whole pad (1 where none were measured)."""
        squares = [t.test.force_sd**2 for t in self.trials if t.test.force_sd is not None]
        return float(np.sqrt(np.mean(np.concatenate(squares)))) if squares else 1.0

    @cached_property  # each level of direct evidence asks for it
    def peak(self) -> float:
        """Largest magnitude of the force, noise aside."""
        return max(largest_force(trial.test) for trial in self.trials)

    @property
    def depth(self) -> float:
        """Largest magnitude of the displacement."""
        return max(float(np.max(np.abs(trial.test.displacement))) for trial in self.trials)

    @property
    def interval(self) -> float:
        """Shortest sampling interval of a test (s), the median of each test's first ones."""
        return min(float(np.median(np.diff(one.test.time)[:200])) for one in self.trials)

    @cached_property
    def scales(self) -> Scales:
        """Sizes that the default priors are scaled to."""
        from qlvbayes.laws.scales import Scales

        tests, whole = zip(*((trial.test, trial.whole) for trial in self.trials), strict=True)
        paths = [trial.trajectory for trial in self.trials]
        floor = self.floor
        return Scales(
            force=self.peak,
            depth=self.depth,
            shortest=self.interval,
            longest=self.longest,
            white=floor.white,
            ou=floor.ou,
            tau=floor.tau,
            speed=max(path.top_speed for path in paths),
            acceleration=max(path.top_acceleration for path in paths),
            clock=max(t.start_s + float(t.time[-1]) for t in whole) - self.clock_zero,
            stiffness=largest_stiffness(tests),
            white_factor=max(1.2, floor.factor("white")),
            tau_factor=max(3.0, floor.factor("tau")),
            mass=self.mass,
        )

    @property
    def clock_zero(self) -> float:
        """Clock (s) at the beginning of the pad's first test."""
        return min(trial.whole.start_s + float(trial.whole.time[0]) for trial in self.trials)

    def tests_before(self, trial: Trial) -> int:
        """Return the number of the pad's tests that began before this one."""
        return sum(other.whole.start_s < trial.whole.start_s for other in self.trials)

    def record(self, trials: Sequence[Trial], *, errors: bool = False) -> Record:
        """Return the block averages of some trials, as one batch.

        errors: whether to include those of the motion's velocity and acceleration.
        """
        from qlvbayes.motion.record import batch

        return batch([self.reduced(trial, errors=errors) for trial in trials])

    def reduced(
        self, trial: Trial, samples: NDArray[np.intp] | None = None, *, errors: bool = False
    ) -> Record:
        """Return the record of a trial; each of ``samples`` of its readings is then a block."""
        from qlvbayes.motion.reduction import reduce_test  # which loads JAX

        return reduce_test(
            trial.test,
            trial.trajectory,
            trial.phases,
            sd_scale=self.sd_scale,
            start=trial.whole.start_s - self.clock_zero,
            number=self.tests_before(trial),
            samples=samples,
            past=self.past(trial),
            fineness=self.fineness,
            approached=trial.approached,
            errors=errors,
        )

    def past(self, trial: Trial) -> EarlierMotion | None:
        """Return the earlier tests that a test remembers; None if it began at rest."""
        if self.rested:
            return None
        names = [t.name for t in self.trials]
        tests, paths = zip(*((t.whole, t.trajectory) for t in self.trials), strict=True)
        return past_of(names.index(trial.name), tests, paths, self.longest)

    @property
    def longest(self) -> float:
        """Length (s) of the longest phase."""
        return max(p.stop - p.start for trial in self.trials for p in trial.phases)


def prepare(
    pad: Pad,
    *,
    all_tests: bool = False,
    keep_all_readings: bool = False,
    use: Sequence[str] = (),
    leave_out: Sequence[str] = (),
) -> Experiment:
    """Find motion, phases, rates and noise floor of a pad, and decide which tests are fitted."""
    trials, steps, cuts = _trials_of(pad, use, leave_out, keep_all=keep_all_readings)
    tests, phases = [t.test for t in trials], [t.phases for t in trials]
    rescaled, fading = with_fading_sd(with_both_errors(tests, phases), phases)
    tests = [replace(t, force_sd=r.force_sd) for t, r in zip(tests, rescaled, strict=True)]
    # a bad reading that is kept is no noise, nor does it show how stiff the pad is
    read = list(map(smooth_readings, tests)) if keep_all_readings else tests
    of_a_step = largest_stiffness(read) * max(steps)
    floor = measure(with_both_errors(read, phases), phases, of_a_step=of_a_step, read=read)
    floor = replace(floor, notices=(*fading, *floor.notices))
    roles = _roles(trials, FIT_RATE * pad.units.mm_per_s)
    every = (
        replace(trial, test=_with_tare_error(test, floor), role="fit" if all_tests else role)
        for trial, test, role in zip(trials, tests, roles, strict=True)
    )
    return Experiment(pad.name, pad.units, tuple(every), floor, pad.fluid, cuts=cuts)


def _with_tare_error(test: Test, floor: NoiseFloor) -> Test:
    """Return a test whose tare has at least the error that correlated noise leaves of it.

    The readings before the contact show how much they scatter, but no noise that is slower than
    they last.
    """
    before = test.time[: int(np.argmax(test.displacement >= 0.0))]
    if not test.tare_sd or not before.size:
        return test
    return replace(test, tare_sd=max(test.tare_sd, floor.sd_of_mean(before)))


def _trials_of(
    pad: Pad, use: Sequence[str], leave_out: Sequence[str], *, keep_all: bool
) -> tuple[list[Trial], list[float], tuple[str, ...]]:
    """Return trials without a role, the encoder's steps, and a sentence on each cut test."""
    pad, slow = with_own_readings(pad)
    part, cuts = cut(pad, use)
    begun = [one.start_s - two.start_s for one, two in zip(part.tests, pad.tests, strict=True)]
    fresh = fresh_forces(part.tests)
    held = held_notices(part.name, part.tests, fresh)
    part, slopes = without_slopes(part)
    phases: list[tuple[Phase, ...]] = [()] * len(begun)
    if any(part.kind for part in parts_of((), leave_out)):
        tests = list(map(with_fresh, part.tests, fresh))
        trials, _, _ = _smoothed(tests, pad.units, keep_all=keep_all, limited=False)
        phases = [trial.phases for trial in trials]
    excluded = [
        excluded_readings(test, part, leave_out, begun=since, phases=cut_into)
        for test, since, cut_into in zip(part.tests, begun, phases, strict=True)
    ]
    tests = []
    for test, why, mask in zip(part.tests, excluded, fresh, strict=True):
        used = None if np.all(why == "") else why == ""
        tests.append(with_fresh(replace(test, used=used), mask))
    trials, bad, steps = _smoothed(tests, pad.units, keep_all=keep_all)
    reasons = (np.where(a == "", b, a) for a, b in zip(bad, excluded, strict=True))
    left_out = map(UnusedReadings.of, tests, reasons)
    trials = [replace(t, left_out=out) for t, out in zip(trials, left_out, strict=True)]
    return trials, steps, (*slow, *held, *slopes, *cuts)


def _smoothed(
    tests: Sequence[Test], units: UnitSystem, *, keep_all: bool, limited: bool = True
) -> tuple[list[Trial], list[Reasons], list[float]]:
    """Return the trials of tests, why readings of each are bad, and the encoder's steps."""
    sound, bad = zip(*sound_tests(tests, keep_all=keep_all, limited=limited), strict=True)
    read = [slice(None) if test.anew is None else test.anew for test in sound]
    times = [test.time[rows] for test, rows in zip(sound, read, strict=True)]
    paths = [test.displacement[rows] for test, rows in zip(sound, read, strict=True)]
    steps = encoder_steps(paths)
    scatters = known_scatter(times, paths, steps)
    trials = [_trial(*one, units) for one in zip(sound, steps, scatters, strict=True)]
    return trials, list(bad), list(steps)


def _trial(whole: Test, step: float, scatter: float, units: UnitSystem) -> Trial:
    if whole.anew is None:
        trajectory = smooth(whole.time, whole.displacement, step, scatter)
    else:
        read = whole.anew.copy()
        read[[0, -1]] = True  # the motion lasts as long as the force
        trajectory = smooth(whole.time[read], whole.displacement[read], step, scatter)
        path = np.where(read, whole.displacement, trajectory.displacement(whole.time))
        whole = replace(whole, displacement=path, anew=None)
    test, recorded = whole, None
    if whole.used is not None:
        test = replace(without(whole, ~whole.used), used=None)
        recorded = replace(whole, used=None)
    phases = phases_of(test, trajectory, controls_of(test, trajectory))
    kinds, rate = {phase.kind for phase in phases}, whole.rate
    if rate is None and "ramp" in kinds:
        rate = loading_rate(trajectory, phases)
    elif rate is None and any(phase.control == Control.FORCE for phase in phases):
        rate = trajectory.top_speed  # of the creep under a weight that is put on at once
    elif rate is None:
        raise no_ramp(whole, trajectory, phases, units)
    return Trial(test, trajectory, phases, rate, whole.role or "", recorded=recorded)


def _roles(trials: Sequence[Trial], fit_rate: float) -> list[str]:
    if any(trial.role == "fit" for trial in trials):
        return [trial.role or "validate" for trial in trials]
    off = [abs(np.log(t.rate / fit_rate)) if t.role != "validate" else np.inf for t in trials]
    return ["fit" if k == np.argmin(off) else "validate" for k in range(len(trials))]
