"""A first look at a pad's tests, before anything is fitted, and what it leaves in a folder."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from qlvbayes.io.contact import FirstContact
from qlvbayes.io.data import Control, Measurements, Pad
from qlvbayes.io.files import results_folder, write_whole
from qlvbayes.io.readings import sampling_of
from qlvbayes.io.units import UnitSystem
from qlvbayes.io.wording import plain
from qlvbayes.motion.evidence import DirectEvidence, contacts_of, direct_evidence
from qlvbayes.motion.experiment import Experiment, Trial, prepare
from qlvbayes.motion.facts import ROUNDED, facts_of, move_of, noise_of
from qlvbayes.motion.past import remembered_tests
from qlvbayes.motion.specimen import pull_notices
from qlvbayes.report.firstlook.result import (
    BY_PHASE,
    ContactSeen,
    FirstLook,
    MotionSeen,
    NoiseSeen,
    PadSeen,
    PhaseSeen,
    TestSeen,
)
from qlvbayes.report.firstlook.shown import shown_between, shown_by

Seen = tuple[PadSeen, bytes | None]
"""First look at a pad, and its picture as a PNG file, where one is drawn."""
Apply = Callable[[Callable[[Pad], Seen], Sequence[Pad]], Iterable[Seen]]
"""Function that applies a task to pads, in order, as ``map`` does."""

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
    by_reading = any(trial.test.force_sd is not None for trial in experiment.trials)
    noise = NoiseSeen(
        floor.total, floor.white, floor.ou, floor.tau, testable=floor.testable,
        by_reading=by_reading,
    )  # fmt: skip
    pulls = pull_notices(experiment, bonded=bonded, effects=effects, shown=seen)
    others = (text for text in experiment.notices if text not in falls)
    return PadSeen(
        experiment.pad, experiment.fluid, noise, tests,
        shown_by(experiment, facts_of(experiment), bonded=bonded),
        (*_corrections(experiment, tests, seen), *falls, *pulls),
        (*others, *(f"pad {experiment.pad}: {text}" for text in floor.notices)),
        seen,
    )  # fmt: skip


def _test(experiment: Experiment, index: int, contact: FirstContact | None) -> TestSeen:
    trial, units = experiment.trials[index], experiment.units
    test, whole, ramp = trial.test, trial.whole, trial.first_ramp
    depths = np.abs(whole.displacement) if units.dimensionless else whole.displacement
    moved = ramp is not None and ramp.control != Control.FORCE
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
        reached=move_of(trial, ramp).speed if ramp is not None and moved else None,
        depth=float(np.max(depths)),
        peak=float(np.max(np.abs(test.force))),
        phases=tuple(_phases(trial)),
        motion=_motion(trial, units),
        contact=None if units.dimensionless else _contact(experiment, trial, contact),
        at_rest=_at_rest(experiment, trial, contact),
        left_out=trial.left_out.count if trial.left_out is not None else 0,
    )


def _phases(trial: Trial) -> list[PhaseSeen]:
    at = trial.trajectory.displacement
    return [
        PhaseSeen(
            phase.kind, phase.start, phase.stop, float(at(np.array([phase.start]))[0]),
            float(at(np.array([phase.stop]))[0]), int(trial.rows(phase.start, phase.stop).size),
            phase.control,
        )
        for phase in trial.phases
    ]  # fmt: skip


def _motion(trial: Trial, units: UnitSystem) -> MotionSeen:
    path, test = trial.trajectory, trial.whole
    left = test.displacement - path.displacement(test.time)
    worst = int(np.argmax(np.abs(left)))
    off, largest = path.departure, float(abs(left[worst]))
    return MotionSeen(
        path.resolution, float(np.sqrt(np.mean(left**2))), largest, float(test.time[worst]),
        largest > ROUNDED * path.resolution > 0.0,
        None if off is None else off.notice(trial.name, units.displacement),
    )  # fmt: skip


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
    units, noise, cautions = experiment.units, noise_of(experiment), list[str]()
    lag = next((o.value for o in seen if o.effect == "channel_lag" and o.beyond_doubt), 0.0)
    for test in tests:
        name, contact = f"pad {experiment.pad}, test {test.test}", test.contact
        if test.peak < _DEAD * noise:
            cautions.append(
                f"{name}: the {units.force_name} never leaves its noise (largest "
                f"{plain(test.peak)} {units.force}, noise {plain(noise, 2)}): see whether the load "
                "cell was connected, or leave the test out"
            )
            continue
        late = lag * (test.reached or 0.0)  # depth by which the force of such a channel rises late
        if contact and contact.position - late > max(_SURE * contact.sd, _TOE * test.depth):
            cautions.append(
                f"{name}: the force begins to rise at {plain(contact.position)} +- "
                f"{plain(contact.sd, 2)} {units.displacement}, and depth counts from zero: shift "
                "the displacement, or let the fit find it by --add contact_offset"
            )
        if test.at_rest is not None:
            cautions.append(
                f"{name}: the {units.force_name} before contact is {plain(test.at_rest)} "
                f"{units.force}: take it off, or let the fit find it by --add force_offset"
            )
    return cautions


def look_into(
    folder: Path | None,
    study: Measurements,
    pads: Sequence[Pad],
    *,
    prepared: Callable[[Pad], Experiment] = prepare,
    bonded: bool | None = None,
    effects: tuple[str, ...] = (),
    files: Sequence[str] = (),
    next_commands: Sequence[str] = (),
    apply: Apply = map,
) -> tuple[FirstLook, list[Path]]:
    """Look at some pads; leave ``look.json`` and a ``look_<pad>.png`` of each in the folder."""
    fixed = study.units.bonded_default if bonded is None else bonded
    results = list(apply(partial(_drawn, prepared, fixed, effects, folder is not None), pads))
    seen = tuple(one for one, _ in results)
    look = FirstLook(
        source=tuple(files or (study.source,)), units=study.units, notices=study.notices, pads=seen,
        between=shown_between(seen, study.units), next=tuple(next_commands),
    )  # fmt: skip
    if folder is None:
        return look, []
    look.write(results_folder(folder) / "look.json")
    figures = [folder / f"look_{one.pad}.png" for one in seen]
    for figure, (_, picture) in zip(figures, results, strict=True):
        write_whole(figure, picture or b"")
    return look, figures


def _drawn(
    prepared: Callable[[Pad], Experiment],
    bonded: bool,
    effects: tuple[str, ...],
    drawn: bool,
    pad: Pad,
) -> Seen:
    experiment = prepared(pad)
    seen = look_at(experiment, bonded=bonded, effects=effects)
    if not drawn:
        return seen, None
    # imported here, so that reading does not wait for matplotlib
    from qlvbayes.plots.files import save_figure
    from qlvbayes.plots.look import plot_look

    with TemporaryDirectory() as folder:
        picture = save_figure(plot_look(experiment), Path(folder) / "look", ("png",))
        return seen, picture.read_bytes()
