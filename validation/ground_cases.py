"""Pads away from the paper's rig, one CSV file each, with their truth."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from qlvbayes.benchmark.wide import run
from qlvbayes.synthetic import HIDDEN, Effect, HiddenPad, draw_effect_in, encode, thin
from qlvbayes.synthetic.laws import Law
from qlvbayes.synthetic.loadcell import LoadCell
from qlvbayes.synthetic.programmes import Session, session

_PRONY = (0.3, 6.2, 0.2, 0.15)
_PLAIN = Law("exponential", (0.5, 0.8), "prony:2", _PRONY)
_USUAL = LoadCell(white=0.004, correlated=0.0055, time=0.5)
_ALL_CORRELATED = LoadCell(correlated=0.008, time=0.5)
_ROWS = 400
_SIZE = 0.06  # of the peak force
_VISIBLE = ("viscous_drag", "friction", "inertia", "frame_compliance", "fluid_leak", "channel_lag")


@dataclass(frozen=True)
class Ground:
    """One pad: what it is called in the table, and how it is made."""

    row: str
    repeat: int
    protocol: str = "paper"
    law: Law = _PLAIN
    cell: LoadCell = _USUAL
    hidden: str | None = None
    carried: bool = False
    exact: bool = False

    @property
    def name(self) -> str:
        """Of its file."""
        return f"{self.row.replace(' ', '_').replace(',', '')}-{self.repeat}"


def grounds() -> Iterator[Ground]:
    """Every pad of the table."""
    hertz = Law("hertz", (0.6,), "prony:2", _PRONY)
    power = Law("exponential", (0.5, 0.8), "power-law", (0.1, 0.03, 0.25))
    long = replace(_USUAL, time=1.0)
    for k in (1, 2):
        yield Ground("sine, nothing", k, "sine")
        yield Ground("sine, drag", k, "sine", hidden="viscous_drag")
        yield Ground("cycles, nothing", k, "cycles")
        yield Ground("cycles, friction", k, "cycles", hidden="friction")
        yield Ground("Hertz pad", k, law=hertz)
        yield Ground("power-law relaxation", k, law=power)
        yield Ground("tests 5 s apart", k, carried=True)
        yield Ground("holds of 5 s, memory 1 s", k, "short_holds", cell=long)
    for k in range(1, 9):
        yield Ground("noise all correlated, nothing", k, cell=_ALL_CORRELATED)
    for k, name in enumerate(_VISIBLE, start=1):
        yield Ground("noise all correlated, one effect", k, cell=_ALL_CORRELATED, hidden=name)
    yield Ground("exact record", 1, cell=LoadCell(encoder=0.0), exact=True)


def make(folder: Path) -> None:
    """Write every pad as NAME.csv and NAME.json."""
    folder.mkdir(parents=True, exist_ok=True)
    for index, ground in enumerate(grounds()):
        rng = np.random.default_rng([18, index])
        plan = session(ground.protocol, ground.carried, 30.0, 0.0, rng)
        pad = HiddenPad(
            ground.law, cells=12 if plan.smooth else 150, frame_speed=True, settled=1e-7
        )
        effects = _effects(ground, pad, plan, rng)
        _write(folder / f"{ground.name}.csv", ground, replace(pad, effects=effects), plan, rng)
        truth = {
            "row": ground.row, "hidden": [e.name for e in effects],
            "parameters": [e.parameters for e in effects], "exact": ground.exact,
        }  # fmt: skip
        text = json.dumps(truth, indent=1) + "\n"
        (folder / f"{ground.name}.json").write_text(text, encoding="utf-8")


def _effects(
    ground: Ground, pad: HiddenPad, plan: Session, rng: np.random.Generator
) -> tuple[Effect, ...]:
    if ground.hidden is None:
        return ()
    assert ground.hidden in HIDDEN
    coarse = replace(pad, cells=12 if plan.smooth else 45, settled=1e-5)
    motions = list(plan.motions.values())
    return (draw_effect_in(ground.hidden, rng, coarse, motions, _SIZE, pad.constants.v),)


def _write(
    path: Path, ground: Ground, pad: HiddenPad, plan: Session, rng: np.random.Generator
) -> None:
    lines = ["pad,test,start_s,time_s,displacement_mm,force_N"]
    times, errors = [], []
    for motion in plan.motions.values():
        every = np.arange(int(motion.duration * 1000.0 + 1e-6) + 1) / 1000.0
        error = ground.cell.draw(every, rng)
        kept = thin(every, encode(motion.displacement(every)), _ROWS)
        times.append(every[kept])
        errors.append(error[kept])
    forces = run(pad, plan, times)
    for (name, motion), t, f, e in zip(plan.motions.items(), times, forces, errors, strict=True):
        place = ground.cell.position(motion.displacement(t))
        start = f"pad,{name},{motion.start_s:.4f}"
        rows = zip(t.tolist(), place.tolist(), (f + e).tolist(), strict=True)
        lines += [f"{start},{a:.4f},{b:.9g},{c:.9g}" for a, b, c in rows]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
