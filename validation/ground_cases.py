"""Pads away from the paper's rig, one CSV file each, with their truth."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from qlvbayes.evaluation.study import run
from qlvbayes.simulate import HIDDEN, Effect, HiddenPad, draw_effect_in, encode, thin
from qlvbayes.simulate.hidden.sensor_effects import Inertia
from qlvbayes.simulate.laws import Law
from qlvbayes.simulate.loadcell import LoadCell
from qlvbayes.simulate.motion import Motion, Piece, Track, joined
from qlvbayes.simulate.programmes import PadProgramme, session, swing

_PRONY = (0.3, 6.2, 0.2, 0.15)
_PLAIN = Law("exponential", (0.5, 0.8), "prony:2", _PRONY)
_BASELINE_CELL = LoadCell(white=0.004, correlated=0.0055, time=0.5)
_ALL_CORRELATED = LoadCell(correlated=0.008, time=0.5)
_ROWS = 400
_SIZE = 0.06  # of the peak force
_VISIBLE = ("viscous_drag", "friction", "inertia", "frame_compliance", "fluid_leak", "channel_lag")
_PAIRS = (
    ("viscous_drag", "fluid_leak"), ("friction", "inertia"),
    ("contact_offset", "viscous_drag"), ("force_drift", "fluid_pressure"),
)  # fmt: skip
_AIR = Law("polynomial", (1e-6, 0.0, 0.0), "prony:2", _PRONY)  # N/mm: nothing is pressed
_AIR_MASS = 6.5e-4  # N s2/mm: 0.65 kg
_AIR_MM_S = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0)
_AIR_STROKE_MM = 5.0
_AIR_GAPS_S = (0.0025, 0.0075)  # between readings, 200 a second on average


@dataclass(frozen=True)
class Ground:
    """One pad: what it is called in the table, and how it is made."""

    row: str
    repeat: int
    protocol: str = "paper"
    law: Law = _PLAIN
    cell: LoadCell = _BASELINE_CELL
    hidden: tuple[str, ...] = ()
    continuous: bool = False
    exact: bool = False

    @property
    def in_air(self) -> bool:
        """A machine that moves its own mass and presses nothing."""
        return self.protocol == "air"

    @property
    def name(self) -> str:
        """Return the name of its file."""
        return f"{self.row.replace(' ', '_').replace(',', '')}-{self.repeat}"


def grounds() -> Iterator[Ground]:
    """Every pad of the table."""
    hertz = Law("hertz", (0.6,), "prony:2", _PRONY)
    power = Law("exponential", (0.5, 0.8), "power-law", (0.1, 0.03, 0.25))
    long = replace(_BASELINE_CELL, time=1.0)
    for k in (1, 2):
        yield Ground("sine, nothing", k, "sine")
        yield Ground("sine, drag", k, "sine", hidden=("viscous_drag",))
        yield Ground("cycles, nothing", k, "cycles")
        yield Ground("cycles, friction", k, "cycles", hidden=("friction",))
        yield Ground("Hertz pad", k, law=hertz)
        yield Ground("power-law relaxation", k, law=power)
        yield Ground("tests 5 s apart", k, continuous=True)
        yield Ground("holds of 5 s, memory 1 s", k, "short_holds", cell=long)
    for k in range(1, 9):
        yield Ground("noise all correlated, nothing", k, cell=_ALL_CORRELATED)
    for k, name in enumerate(_VISIBLE, start=1):
        yield Ground("noise all correlated, one effect", k, cell=_ALL_CORRELATED, hidden=(name,))
    yield Ground("exact record", 1, cell=LoadCell(encoder=0.0), exact=True)
    for k, pair in enumerate(_PAIRS, start=1):
        yield Ground("noise all correlated, two effects", k, cell=_ALL_CORRELATED, hidden=pair)
    for k in (1, 2):
        yield Ground("machine in air", k, "air", _AIR, replace(_BASELINE_CELL, encoder=0.01))


def make(folder: Path) -> None:
    """Write every pad as NAME.csv and NAME.json."""
    folder.mkdir(parents=True, exist_ok=True)
    for index, ground in enumerate(grounds()):
        rng = np.random.default_rng([18, index])
        plan = (
            _air() if ground.in_air else session(ground.protocol, ground.continuous, 30.0, 0.0, rng)
        )
        pad = HiddenPad(
            ground.law, cells=12 if plan.smooth else 150, frame_speed=True, settled=1e-7
        )
        effects = _effects(ground, pad, plan, rng)
        _write(folder / f"{ground.name}.csv", ground, replace(pad, effects=effects), plan, rng)
        truth = {
            "row": ground.row, "hidden": [e.name for e in effects],
            "parameters": [e.parameters for e in effects], "exact": ground.exact,
            "options": ["--bonded"] if ground.in_air else [],
        }  # fmt: skip
        text = json.dumps(truth, indent=1) + "\n"
        (folder / f"{ground.name}.json").write_text(text, encoding="utf-8")


def _air() -> PadProgramme:
    """Out and back without jerk, at six speeds, with rests of 2 s."""
    motions: dict[str, Motion] = {}
    clock = 0.0
    rest = (Piece(0.0, 2.0, 0.0, 0.0, 0.0),)
    for speed in _AIR_MM_S:
        there, back = swing(_AIR_STROKE_MM, speed), swing(-_AIR_STROKE_MM, speed)
        motions[f"{speed:g}"] = Track(joined([rest, there, rest, back, rest]), clock)
        clock += motions[f"{speed:g}"].duration + 60.0
    return PadProgramme(motions, False, 60.0, 2.0, True)


def _effects(
    ground: Ground, pad: HiddenPad, plan: PadProgramme, rng: np.random.Generator
) -> tuple[Effect, ...]:
    if ground.in_air:
        return (Inertia(_AIR_MASS),)
    assert set(ground.hidden) <= set(HIDDEN)
    coarse = replace(pad, cells=12 if plan.smooth else 45, settled=1e-5)
    motions = list(plan.motions.values())
    rates = pad.constants.v
    return tuple(draw_effect_in(name, rng, coarse, motions, _SIZE, rates) for name in ground.hidden)


def _write(
    path: Path, ground: Ground, pad: HiddenPad, plan: PadProgramme, rng: np.random.Generator
) -> None:
    lines = ["pad,test,start_s,time_s,displacement_mm,force_N"]
    times, errors = [], []
    for motion in plan.motions.values():
        every = _clock(ground, motion.duration, rng)
        error = ground.cell.draw(every, rng)
        rows = every.size if ground.in_air else _ROWS
        kept = thin(every, encode(motion.displacement(every)), rows)
        times.append(every[kept])
        errors.append(error[kept])
    forces = run(pad, plan, times)
    for (name, motion), t, f, e in zip(plan.motions.items(), times, forces, errors, strict=True):
        position = ground.cell.position(motion.displacement(t))
        start = f"pad,{name},{motion.start_s:.4f}"
        rows = zip(t.tolist(), position.tolist(), (f + e).tolist(), strict=True)
        lines += [f"{start},{a:.4f},{b:.9g},{c:.9g}" for a, b, c in rows]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _clock(ground: Ground, duration: float, rng: np.random.Generator) -> np.ndarray:
    """Moments of all readings, s: 1 kHz, or the uneven ones of a machine in air."""
    if not ground.in_air:
        return np.arange(int(duration * 1000.0 + 1e-6) + 1) / 1000.0
    gaps = rng.uniform(*_AIR_GAPS_S, int(duration / _AIR_GAPS_S[0]))
    times = np.round(np.cumsum(gaps) - gaps[0], 4)
    return times[times <= duration]
