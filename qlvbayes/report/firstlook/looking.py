"""A first look at a pad's tests, before anything is fitted."""

from __future__ import annotations

import numpy as np

from qlvbayes.io.contact import FirstContact
from qlvbayes.io.data import Control
from qlvbayes.io.readings import sampling_of
from qlvbayes.io.units import UnitSystem
from qlvbayes.io.wording import plain
from qlvbayes.motion.evidence import DirectEvidence, direct_evidence
from qlvbayes.motion.evidence.touching import contacts_of
from qlvbayes.motion.experiment import Experiment, Trial
from qlvbayes.motion.facts import ROUNDED, facts_of, move_of, noise_of
from qlvbayes.motion.past import remembered_tests
from qlvbayes.motion.specimen import pull_notices
from qlvbayes.report.firstlook.result import (
    BY_PHASE,
    ContactSeen,
    MotionSeen,
    NoiseSeen,
    PadSeen,
    PhaseSeen,
    TestSeen,
)
from qlvbayes.report.firstlook.shown import shown_by

_SURE = 4.0  # standard errors, from which on contact is not at the file's zero,
_TOE = 0.1  # and of the depth: a force that begins softly rises out of the noise as late
_OFF = 0.02  # of the peak force, below which a force at rest does no harm,
_NOISY = 3.0  # and times the noise
_AT_ZERO = 0.01  # of the depth, within which the platen has not left the file's zero
_RESTS = 5  # readings there, that show the force at rest
_DEAD = 6.0  # times the noise, below which a test's force has not answered


def look_at(experiment: Experiment, *, bonded: bool, effects: tuple[str, ...] = ()) -> PadSeen:
    """Describe a pad's tests, and which parts of the model they can show."""
    floor, falls = experiment.floor, experiment.falls
    contacts = contacts_of(experiment)
    tests = tuple(_test(experiment, k, contact) for k, contact in enumerate(contacts))
    seen = direct_evidence(experiment, bonded, contacts)
    return PadSeen(
        experiment.pad,
        experiment.fluid,
        NoiseSeen(
            floor.total,
            floor.white,
            floor.ou,
            floor.tau,
            testable=floor.testable,
            by_reading=any(trial.test.force_sd is not None for trial in experiment.trials),
        ),
        tests,
        shown_by(experiment, facts_of(experiment), bonded=bonded),
        (
            *_corrections(experiment, tests, seen),
            *falls,
            *pull_notices(experiment, bonded=bonded, effects=effects, shown=seen),
        ),
        (
            *(text for text in experiment.notices if text not in falls),
            *(f"pad {experiment.pad}: {text}" for text in floor.notices),
        ),
        seen,
    )


def _test(experiment: Experiment, index: int, contact: FirstContact | None) -> TestSeen:
    trial = experiment.trials[index]
    test, whole, ramp = trial.test, trial.whole, trial.first_ramp
    tests = [one.whole for one in experiment.trials]
    before = () if experiment.rested else remembered_tests(index, tests, experiment.longest)
    return TestSeen(
        test=test.name,
        role=trial.role,
        control=BY_PHASE if trial.control is None else trial.control,
        control_declared=test.states_control,
        readings=test.time.size,
        duration=float(whole.time[-1] - whole.time[0]),
        interval=float(np.median(np.diff(whole.time))),
        sampling=sampling_of(whole.time).describe(),
        clock_sd=trial.trajectory.clock_sd,
        start=whole.start_s,
        start_known=test.start_known,
        after=tuple(experiment.trials[k].name for k in before),
        rate=trial.rate if np.isfinite(trial.rate) else None,
        reached=None
        if ramp is None or ramp.control == Control.FORCE
        else move_of(trial, ramp).speed,
        depth=_depth(trial, experiment.units),
        peak=float(np.max(np.abs(test.force))),
        phases=tuple(_phases(trial)),
        motion=_motion(trial, experiment.units),
        contact=None if experiment.units.dimensionless else _contact(experiment, trial, contact),
        at_rest=_at_rest(experiment, trial, contact),
        left_out=trial.left_out.count if trial.left_out is not None else 0,
    )


def _depth(trial: Trial, units: UnitSystem) -> float:
    """Return the largest displacement, in magnitude, of a test."""
    displacement = trial.whole.displacement
    return float(np.max(np.abs(displacement) if units.dimensionless else displacement))


def _phases(trial: Trial) -> list[PhaseSeen]:
    ends = [
        map(float, trial.trajectory.displacement(np.array([phase.start, phase.stop])))
        for phase in trial.phases
    ]
    return [
        PhaseSeen(
            phase.kind,
            phase.start,
            phase.stop,
            begin,
            end,
            int(trial.rows(phase.start, phase.stop).size),
            phase.control,
        )
        for phase, (begin, end) in zip(trial.phases, ends, strict=True)
    ]


def _motion(trial: Trial, units: UnitSystem) -> MotionSeen:
    path, test = trial.trajectory, trial.whole
    left = test.displacement - path.displacement(test.time)
    worst = int(np.argmax(np.abs(left)))
    off = path.departure
    return MotionSeen(
        path.resolution,
        float(np.sqrt(np.mean(left**2))),
        float(abs(left[worst])),
        float(test.time[worst]),
        bool(abs(left[worst]) > ROUNDED * path.resolution > 0.0),
        None if off is None else off.notice(trial.name, units.displacement),
    )


def _contact(
    experiment: Experiment, trial: Trial, contact: FirstContact | None
) -> ContactSeen | None:
    """Return the contact of a test as it is told; None if no approach shows it."""
    if contact is None:
        return None
    begun = float(trial.test.displacement[0]) > _AT_ZERO * experiment.depth
    if begun and contact.force > _clear(experiment):
        return None
    return ContactSeen(contact.position, contact.sd, contact.force, float(contact.tare_sd))


def _at_rest(experiment: Experiment, trial: Trial, contact: FirstContact | None) -> float | None:
    """Return the force before contact if it is clearly not zero; else None."""
    test = trial.test
    if contact is not None and contact.sliding:  # what rubs as the platen moves is no force at rest
        return contact.force if abs(contact.force) > _clear(experiment) else None
    first = trial.first_ramp
    if experiment.units.dimensionless or (first or trial.phases[0]).control == Control.FORCE:
        return None
    begin = test.time[0] if first is None else first.start
    near = np.abs(test.displacement) <= _AT_ZERO * experiment.depth
    before = (near & (test.time < begin)) | (
        (test.displacement < -_AT_ZERO * experiment.depth)
        & (test.time < test.time[np.argmax(np.abs(test.force))])
    )
    if np.count_nonzero(before) < _RESTS:
        return None
    force = float(np.median(test.force[before]))
    return force if abs(force) > _clear(experiment) else None


def _clear(experiment: Experiment) -> float:
    """Return the force that a load cell at rest clearly does not show."""
    return max(_NOISY * experiment.floor.total, _OFF * experiment.peak)


def _corrections(
    experiment: Experiment, tests: tuple[TestSeen, ...], seen: tuple[DirectEvidence, ...]
) -> list[str]:
    """Return sentences on what to correct or to decide before a fit."""
    units, noise, cautions = experiment.units, noise_of(experiment), []
    lag = next((o.value for o in seen if o.effect == "channel_lag" and o.beyond_doubt), 0.0)
    for test in tests:
        name = f"pad {experiment.pad}, test {test.test}"
        if test.peak < _DEAD * noise:
            cautions.append(
                f"{name}: the {units.force_name} never leaves its noise (largest "
                f"{plain(test.peak)} {units.force}, noise {plain(noise, 2)}): see whether the load "
                "cell was connected, or leave the test out"
            )
            continue
        late = lag * (test.reached or 0.0)
        cautions += [f"{name}: {text}" for text in _of_contact(test, units, late)]
    return cautions


def _of_contact(test: TestSeen, units: UnitSystem, late: float) -> list[str]:
    """Return sentences on a test's contact, and on the force before it.

    late: depth by which the force rises too late, as its channel lags.
    """
    contact, cautions = test.contact, []
    if contact and contact.position - late > max(_SURE * contact.sd, _TOE * test.depth):
        cautions.append(
            f"the force begins to rise at {plain(contact.position)} +- {plain(contact.sd, 2)} "
            f"{units.displacement}, and depth counts from zero: shift the displacement, or let the "
            "fit find it by --add contact_offset"
        )
    if test.at_rest is not None:
        cautions.append(
            f"the {units.force_name} before contact is {plain(test.at_rest)} {units.force}: take "
            "it off, or let the fit find it by --add force_offset"
        )
    return cautions
