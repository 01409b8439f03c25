"""Make one blind study: a random pad with hidden effects, simulated and measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from blind.catalogue import KINDS
from blind.contact import NearContact
from blind.disturbed import (
    NoiseGain,
    held_forces,
    late_start,
    unequal_holds,
    with_lost_readings,
)
from blind.laws import Law, draw_law, log_uniform
from blind.loadcell import LoadCell, draw_cell
from blind.population import RECORD, Item, Population
from blind.programmes import PadProgramme, session
from qlvbayes.io.data import Pad, Test
from qlvbayes.io.units import PAD
from qlvbayes.simulate import Effect, HiddenPad, SimulatedTest, draw_effect_in, encode, thin

SIZES = (0.005, 0.15)  # largest contribution of an effect over the peak force
GAP_MM = (0.0, 0.02)  # the platen starts this far above the pad
WIDTH_MM = (0.001, 0.005)  # contact comes within about this
CREEP_MM = 4e-4  # most that the platen moves on in a hold: less than half an encoder step
ROWS = 350  # of a thinned test
HOLD_S = {"full": 4.0, "uniform": 10.0, "thinned": 30.0}  # by logger
RATE_HZ = {"full": 1000.0, "uniform": 50.0, "thinned": 1000.0}
_A_CYCLE = 20  # samples of a slow logger in a cycle of the sine
_DEPTH = 1.6  # mm, about: sets the law's constants
_CELLS = {False: 150, True: 12}  # of the solver in a stretch, by whether the motion is smooth
_DRAWING_CELLS = {False: 45, True: 12}  # the same, where only the size of an effect is drawn
_SETTLED = 1e-7  # share of the stroke
_DRAWING_SETTLED = 1e-5  # the same, where only the size of an effect is drawn


@dataclass(frozen=True, eq=False)
class BlindStudy:
    """True material, hidden effects, rig and simulated readings of one study.

    sizes: the contribution of each hidden effect that was asked for, over the peak force; rig: gap
    (mm) and width (mm) of the contact; creep: movement of the platen in a hold (mm); times: sampled
    times of every test (s); peak: peak force without the effects (N); pad: the readings; gain: of
    noise that changes along the tests.
    """

    item: Item
    law: Law
    effects: tuple[Effect, ...]
    sizes: tuple[float, ...]
    rig: NearContact
    creep: float
    session: PadProgramme
    cell: LoadCell
    times: tuple[np.ndarray, ...]
    peak: float
    pad: Pad
    gain: NoiseGain | None = None

    def material(self, law: Law, effects: Sequence[Effect]) -> HiddenPad:
        """Return the simulated pad of this law and these effects, on this rig."""
        return _material(law, (self.rig, *effects), self.session.smooth)

    def forces(
        self, law: Law, effects: Sequence[Effect], times: Sequence[np.ndarray]
    ) -> list[np.ndarray]:
        """Return the true force (N) of every test at these times (s)."""
        return run(self.material(law, effects), self.session, times)


def make_study(population: Population, index: int) -> BlindStudy:
    """Simulate one study of a population."""
    item, rng = population.item(index), population.rng(index)
    levels = item.levels
    creep = float(rng.uniform(-CREEP_MM, CREEP_MM))
    plan = session(
        levels["protocol"], levels["history"] == "carried", HOLD_S[levels["logger"]], creep, rng
    )
    record, own = levels.get(RECORD, "plain"), population.record_rng(index)
    if record == "unequal_holds":
        plan = unequal_holds(plan, own)
    gain = NoiseGain.drawn(own) if record == "changing_noise" else None
    law = draw_law(levels["elastic"], levels["relaxation"], rng, _DEPTH)
    rig = NearContact(float(rng.uniform(*GAP_MM)), float(rng.uniform(*WIDTH_MM)))
    effects, sizes, peak = _hidden(item, law, rig, plan, rng)
    cell = draw_cell(levels["noise"], peak, plan.longest_hold, rng)
    pad = _material(law, (rig, *effects), plan.smooth)
    if record == "held_force":
        plan = held_forces(plan, partial(run, pad), own)
    logger, name = levels["logger"], f"study {index}"
    times, readings = _measure(pad, plan, cell, peak, logger, rng, name, gain)
    times, readings = _disturbed(record, times, readings, own)
    return BlindStudy(
        item, law, effects, sizes, rig, creep, plan, cell, times, peak, readings, gain
    )


def _disturbed(
    record: str, times: tuple[np.ndarray, ...], pad: Pad, rng: np.random.Generator
) -> tuple[tuple[np.ndarray, ...], Pad]:
    """Return sampled times and readings, some of which are lost or come before a late start."""
    if record not in ("lost_readings", "late_start"):
        return times, pad
    tests, kept = [], []
    for test, time in zip(pad.tests, times, strict=True):
        first = late_start(test.displacement, rng) if record == "late_start" else 0
        displacement, force = test.displacement, test.force
        if record == "lost_readings":
            displacement, force = with_lost_readings(displacement, force, rng)
        kept.append(time[first:])
        begun = float(test.time[first])
        tests.append(
            replace(
                test,
                time=test.time[first:] - begun,
                displacement=displacement[first:],
                force=force[first:],
                start_s=test.start_s + begun,
            )
        )
    return tuple(kept), replace(pad, tests=tuple(tests))


def measured(tests: Sequence[SimulatedTest], name: str) -> Pad:
    """Return simulated tests of one pad as if they had been read from a file."""
    read = tuple(
        Test(t.name, name, t.record.time, t.record.displacement, t.record.force, start_s=t.start_s)
        for t in tests
    )
    return Pad(name, read, PAD)


def run(pad: HiddenPad, plan: PadProgramme, times: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Return the true force (N) of every test at these times (s).

    Where the session is continuous, each test remembers those before it.
    """
    motions = list(plan.motions.values())
    if not plan.continuous:
        return [pad.force(m, t) for m, t in zip(motions, times, strict=True)]
    clock = [m.start_s - motions[0].start_s for m in motions]
    moments = np.concatenate([c + t for c, t in zip(clock, times, strict=True)])
    edges = np.cumsum([t.size for t in times])[:-1]
    whole = plan.whole
    return np.split(pad.force(whole, np.minimum(moments, whole.duration)), edges)


def _material(law: Law, effects: Sequence[Effect], smooth: bool) -> HiddenPad:
    return HiddenPad(law, tuple(effects), cells=_CELLS[smooth], frame_speed=True, settled=_SETTLED)


def _hidden(
    item: Item, law: Law, rig: NearContact, plan: PadProgramme, rng: np.random.Generator
) -> tuple[tuple[Effect, ...], tuple[float, ...], float]:
    """Return the effects, their sizes, and the peak force (N) of the pad without them."""
    pad = replace(
        _material(law, (rig,), plan.smooth),
        cells=_DRAWING_CELLS[plan.smooth],
        settled=_DRAWING_SETTLED,
    )
    motions = list(plan.motions.values())
    sizes = tuple(log_uniform(rng, *SIZES) for _ in item.names)
    own = law.v if len(law.v) <= 3 else ()
    effects = tuple(
        draw_effect_in(KINDS[name], rng, pad, motions, size, own)
        for name, size in zip(item.names, sizes, strict=True)
    )
    peak = max(float(pad.force(m, np.linspace(0.0, m.duration, 400)).max()) for m in motions)
    return effects, sizes, peak


def _measure(
    pad: HiddenPad,
    plan: PadProgramme,
    cell: LoadCell,
    peak: float,
    logger: str,
    rng: np.random.Generator,
    name: str,
    gain: NoiseGain | None,
) -> tuple[tuple[np.ndarray, ...], Pad]:
    """Return the sampled times of every test, and the readings of encoder and load cell."""
    times, read, errors = [], [], []
    for label, motion in plan.motions.items():
        every = _clock(motion.duration, logger, label)
        position, error = cell.position(motion.displacement(every)), cell.draw(every, rng)
        error = error if gain is None else error * gain.at(every, motion.duration)
        kept = (
            thin(every, encode(motion.displacement(every)), ROWS)
            if logger == "thinned"
            else np.arange(every.size)
        )
        times.append(every[kept])
        read.append(position[kept])
        errors.append(error[kept])
    forces = run(pad, plan, [cell.moments(t, rng) for t in times])
    tests = [
        Test(label, name, t, d, cell.read(f, e, peak), start_s=motion.start_s, start_known=True)
        for (label, motion), t, d, f, e in zip(
            plan.motions.items(), times, read, forces, errors, strict=True
        )
    ]
    return tuple(times), Pad(name, tuple(tests), PAD)


def _clock(duration: float, logger: str, label: str) -> np.ndarray:
    """Return the times (s) of a logger; a slow one takes 20 samples in a cycle of a sine."""
    rate = RATE_HZ[logger]
    if logger == "uniform" and label.endswith(" Hz"):
        rate = _A_CYCLE * float(label.removesuffix(" Hz"))
    return np.arange(int(duration * rate + 1e-6) + 1) / rate
