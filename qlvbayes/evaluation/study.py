"""One simulated pad that hides one effect, or nothing, from simulation to verdict."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from qlvbayes.diagnosis.diagnose import diagnose
from qlvbayes.evaluation.session import RigSession
from qlvbayes.io.checks import InputError
from qlvbayes.io.data import Pad, Test
from qlvbayes.io.units import PAD
from qlvbayes.model.choices import Choices
from qlvbayes.motion.experiment import prepare
from qlvbayes.simulate import HIDDEN, HiddenPad, draw_effect_in, encode

NOTHING = "nothing"
"""In place of an effect's name."""
FAILED = "failed"
"""In place of a verdict, where the program stopped."""


def effects_of(names: tuple[str, ...], *, bonded: bool) -> tuple[str, ...]:
    """Return the effects to hide: those named, or all that a pad held in this way can have."""
    known = [name for name, kind in HIDDEN.items() if bonded or not kind.slides]
    if unknown := [name for name in names if name not in known]:
        raise InputError(f"no effect {unknown[0]!r}", remedy=f"use some of {', '.join(known)}")
    return names or tuple(known)


@dataclass(frozen=True, eq=False)
class Benchmark:
    """Pads of one session that each hide an effect of one size, or nothing.

    size: largest contribution of the effect in the tests, over the peak force; each pad depends on
    the seed, the effect and its own number alone.
    """

    session: RigSession
    size: float
    seed: int

    @property
    def key(self) -> str:
        """Name that identifies the pads."""
        return f"seed{self.seed}-size{self.size:g}-{self.session.key}"

    def measured(self, name: str, number: int) -> tuple[Pad, dict[str, Any]]:
        """Return one pad's readings, and what it hides; the effect's share is of the peak force."""
        session = self.session
        rng = np.random.default_rng([self.seed, number, *name.encode()])
        plain = HiddenPad(session.constants, bonded=session.bonded)
        tests = list(zip(session.motions, session.times, strict=True))
        forces = [plain.force(motion, times) for motion, times in tests]
        hidden: dict[str, Any] = {"share": 0.0, "parameters": {}}
        if name != NOTHING:
            motions, rates = session.motions, session.constants.v
            effect = draw_effect_in(name, rng, plain, motions, self.size, rates)
            pad = HiddenPad(session.constants, (effect,), session.bonded)
            changed = [pad.force(motion, times) for motion, times in tests]
            added = max(np.abs(a - b).max() for a, b in zip(changed, forces, strict=True))
            peak = max(force.max() for force in forces)
            hidden = {"share": float(added / peak), "parameters": effect.parameters}
            forces = changed
        readings = []
        for label, (motion, times), force in zip(session.names, tests, forces, strict=True):
            depth = motion.displacement(times)
            depth = encode(depth, session.encoder) if session.encoder else depth
            read = session.errors.read(times, force, rng)
            start = motion.start_s
            readings.append(Test(label, name, times, depth, read, start_s=start, start_known=True))
        return Pad(name, tuple(readings), PAD), hidden

    def run(self, study: tuple[str, int]) -> dict[str, Any]:
        """Simulate and diagnose the pad of an effect and a number; return plain values."""
        name, number = study
        pad, hidden = self.measured(name, number)
        case = {"plan": self.key, "index": index_of(study), "hidden": name, **hidden}
        choices = Choices(rested=True, bonded=self.session.bonded)
        try:
            result = diagnose(prepare(pad), choices).result
        except Exception as error:  # one bad pad must not end a run of hundreds
            text = f"{type(error).__name__}: {error}"
            return case | {"verdict": FAILED, "error": text, "effects": [], "group": []}
        found = {ranked.effect: ranked.inclusion for ranked in result.ranking}
        return case | {
            "verdict": result.verdict,
            "effects": list(result.effects),
            "group": list(result.group),
            "probability": found.get(name),
        }


def index_of(study: tuple[str, int]) -> str:
    """Return what a study is stored under."""
    name, number = study
    return f"{name} {number}"
