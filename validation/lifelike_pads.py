"""Lifelike pads: never exactly what any model says, on a rig that is never quite known.

Every study has a part that no listed effect is, of 0.3 to 3 % of the peak force; its stiffness and
the strengths of its hidden effects scatter from test to test; its motion is limited in jerk; its
tests share one contact, and the zero that is given for it is wrong by up to 20 um.

`lifelike_sizes` says how large effects are and when they can be seen.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from blind.laws import ELASTIC, RELAXATION, Law, draw_law, log_uniform
from blind.lists import PRESENT
from blind.loadcell import LoadCell
from blind.population import kin
from lifelike_rig import (
    PROGRAMMES,
    UNLISTED,
    UNLISTED_IN_AIR,
    JerkLimited,
    Plan,
    draw_air_plan,
    draw_plan,
)
from lifelike_sizes import CELLS, CONTACT_MM, SEEN, Rig, Sizes, pad_of
from numpy.typing import NDArray

from qlvbayes.io.data import Pad, Test
from qlvbayes.io.units import PAD
from qlvbayes.simulate import ENCODER_STEP, Effect, Hold, Move, Step, encode, thin

Array = NDArray[np.float64]

BLOCK = ("none",) * 5 + ("single",) * 10 + ("air", "sticky") + ("double",) * 3
"""What is hidden in twenty studies: nothing, a listed effect, a mass alone in air, an adhesion that
grows with the press on a Hertzian pad, two listed effects."""
SPREAD = 0.4  # largest sd of the logarithm of an effect's strength from test to test,
STIFFNESS_SPREAD = 0.1  # and of the stiffness's
NOISE = (2e-4, 1e-2)  # sd over the peak
_WIDTH_MM = (0.001, 0.005)  # within which contact comes about
_ROWS = (2500, 5500)  # of all tests
_RATES_HZ = (10.0, 20.0, 25.0, 50.0, 100.0, 200.0, 250.0, 500.0, 1000.0)
_HOLD_S = {"thinned": 30.0, "uniform": 6.0}
_CREEP_MM = 4e-4
_PAUSE_S = 120.0
_AIR_N = (0.1, 1.0)  # largest force on the mass
_AIR_SPREAD = 0.05  # a mass stays what it is; its motion is not quite known
_ATTEMPTS = 6


@dataclass(frozen=True)
class Item:
    """The entry of `BLOCK` that one study of a seed is, and the names of what it hides."""

    scene: str
    names: tuple[str, ...]

    @property
    def kind(self) -> str:
        """The kind by which the study is counted."""
        return "single" if self.scene in ("air", "sticky") else self.scene


def item(seed: int, index: int) -> Item:
    """Return what one study hides; all names come equally often among the singles."""
    block, place = divmod(index, len(BLOCK))
    order = np.random.default_rng([seed, block, *b"lifelike"]).permutation(len(BLOCK))
    number = int(order[place])
    scene = BLOCK[number]
    if scene == "none":
        return Item(scene, ())
    if scene in ("air", "sticky"):
        return Item(scene, ("inertia" if scene == "air" else "adhesion",))
    singles = BLOCK.count("single")
    if scene == "single":
        turn, k = divmod(block * singles + number - BLOCK.index("single"), len(PRESENT.listed))
        names = np.random.default_rng([seed, turn, *b"names"]).permutation(PRESENT.listed)
        return Item(scene, (str(names[k]),))
    rng = np.random.default_rng([seed, index, *b"pair"])
    first = str(rng.choice(PRESENT.listed))
    others = [name for name in PRESENT.listed if name not in {first, *kin(first)}]
    return Item(scene, (first, str(rng.choice(others))))


@dataclass(frozen=True, eq=False)
class Lifelike:
    """One study with its truth.

    strengths, stiffness: factors of every test on the effects' strengths and on the stiffness;
    spreads: standard deviations of their logarithms, the stiffness's last; seen: how many times
    each effect exceeds what hides it (`SEEN`); left: root mean squares in its phases over the peak,
    of the effect, of the unlisted part, and the noise of a phase mean; peak: of the force, N.
    """

    item: Item
    law: Law
    effects: tuple[Effect, ...]
    strengths: tuple[tuple[float, ...], ...]
    stiffness: tuple[float, ...]
    spreads: tuple[float, ...]
    unlisted: Effect
    unlisted_share: float
    seen: dict[str, float]
    left: dict[str, tuple[float, float, float]]
    rig: Rig
    cell: LoadCell
    peak: float
    pad: Pad

    def forces(self, unlisted: bool = True, effects: bool = True) -> list[Array]:
        """Return the true forces (N) of all tests, with or without its parts."""
        extra = (self.unlisted,) if unlisted else ()
        pads = []
        for k, factor in enumerate(self.stiffness):
            own = [strengthened(e, s[k]) for e, s in zip(self.effects, self.strengths, strict=True)]
            law = stiffened(self.law, factor)
            pads.append(pad_of(law, self.rig, [*(own if effects else ()), *extra], CELLS))
        return self.rig.forces(pads)


def make_study(seed: int, index: int) -> Lifelike:
    """Simulate one study; what cannot be seen in the first draw is drawn again, some times."""
    what, best = item(seed, index), None
    for attempt in range(_ATTEMPTS):
        rng = np.random.default_rng([seed, index, attempt, *b"lifelike study"])
        try:
            study = _drawn(what, f"study {index}", rng)
        except RuntimeError:  # the solver finds no balance
            continue
        if best is None or min(study.seen.values()) > min(best.seen.values()):
            best = study
        if all(value >= SEEN for value in study.seen.values()):
            break
    if best is None:
        raise RuntimeError("the simulation stopped in every draw")
    return best


def _drawn(what: Item, name: str, rng: np.random.Generator) -> Lifelike:
    rig = _rig(what.scene, rng)
    law = _law(what.scene, rig.plan, rng)
    count = len(rig.motions)
    bare = rig.forces([pad_of(law, rig, ())] * count)
    peak = max(float(force.max()) for force in bare)
    air = what.scene == "air"
    peak = log_uniform(rng, *_AIR_N) if air else peak
    noise = peak * log_uniform(rng, *NOISE)
    white = float(rng.uniform(0.3, 0.95))
    cell = LoadCell(
        white=white * noise, correlated=(1.0 - white**2) ** 0.5 * noise,
        time=log_uniform(rng, 0.2, 1.5), encoder=ENCODER_STEP,
    )  # fmt: skip
    stiffness_spread = float(rng.uniform(0.0, STIFFNESS_SPREAD))
    sizes = Sizes(law, rig, bare, peak, cell, stiffness_spread, rng)
    unlisted, shared = sizes.unlisted(UNLISTED_IN_AIR if air else UNLISTED)
    effects, seen, left = [], {}, {}
    for one in what.names:
        hidden = "adhesion_at_a_stretch" if what.scene == "sticky" else one
        effect, seen[one], left[one] = sizes.listed(hidden, shared, air)
        effects.append(effect)
    spreads = [float(rng.uniform(0.0, _AIR_SPREAD if air else SPREAD)) for _ in effects]
    spreads.append(stiffness_spread)
    factors = [tuple(np.exp(s * rng.standard_normal(count)).tolist()) for s in spreads]
    if what.scene == "sticky":
        power = float(rng.uniform(0.4, 1.0))
        deep = [(rig.plan.depth_of(test) / rig.plan.depth) ** power for test in rig.motions]
        factors[0] = tuple(f * d for f, d in zip(factors[0], deep, strict=True))
    study = Lifelike(
        what, law, tuple(effects), tuple(factors[:-1]), factors[-1], tuple(spreads), unlisted, 0.0,
        seen, left, rig, cell, peak, Pad(name, (), PAD),
    )  # fmt: skip
    return _measured(study, name, sizes.share, rng)


def _measured(study: Lifelike, name: str, wanted: float, rng: np.random.Generator) -> Lifelike:
    """Return the study with its readings, and with an unlisted part of the size wanted."""
    rig, cell = study.rig, study.cell
    without = study.forces(unlisted=False)
    peak = max(float(np.abs(force).max()) for force in without)

    def with_share() -> tuple[list[Array], float]:
        whole = study.forces()
        part = rig.rms([a - b for a, b in zip(whole, without, strict=True)])
        return whole, float(np.sqrt(np.mean(part**2))) / peak

    _, share = with_share()  # scatter and effects have changed it a little
    study = replace(study, unlisted=strengthened(study.unlisted, wanted / share))
    whole, share = with_share()
    tests = []
    for (label, motion), t, force in zip(rig.motions.items(), rig.times, whole, strict=True):
        read = encode(motion.displacement(t), cell.encoder)
        force = force + cell.draw(t, rng)
        tests.append(Test(label, name, t, read, force, start_s=motion.start_s, start_known=True))
    return replace(study, unlisted_share=share, peak=peak, pad=Pad(name, tuple(tests), PAD))


def _rig(scene: str, rng: np.random.Generator) -> Rig:
    logger = str(rng.choice(list(_HOLD_S)))
    programme = "depths" if scene == "sticky" else str(rng.choice(PROGRAMMES))
    plan = draw_air_plan(rng) if scene == "air" else draw_plan(programme, _HOLD_S[logger], rng)
    if scene == "sticky":  # what sticks is drawn off the surface
        off = -plan.depth * float(rng.uniform(0.1, 0.3))
        plan = replace(plan, programs={k: _lifted(p, off) for k, p in plan.programs.items()})
    contact = float(rng.uniform(-CONTACT_MM, CONTACT_MM))
    creep = float(rng.uniform(-_CREEP_MM, _CREEP_MM))
    rows = int(rng.uniform(*_ROWS) / len(plan.programs))
    motions: dict[str, JerkLimited] = {}
    times, clock = [], 0.0
    for number, (name, program) in enumerate(plan.programs.items()):
        steps = tuple(_creeping(step, creep) for step in program)
        motion = JerkLimited(steps, plan.jerk, -plan.lead, clock, number)
        motions[name] = motion
        times.append(sampled(motion, logger, rows))
        clock += motion.duration + _PAUSE_S
    width = float(rng.uniform(*_WIDTH_MM))
    return Rig(plan, contact, width, motions, logger, tuple(times))


def _creeping(step: Step, creep: float) -> Step:
    return replace(step, creep=creep) if isinstance(step, Hold) else step


def _lifted(program: tuple[Step, ...], off: float) -> tuple[Step, ...]:
    """Return a program whose returns to the surface end above it."""
    return tuple(
        replace(step, target=off) if isinstance(step, Move) and step.target <= 0.0 else step
        for step in program
    )


def sampled(motion: JerkLimited, logger: str, rows: int) -> Array:
    """Return the times (s) that the logger keeps: thinned from 1 kHz, or at one rate a test."""
    if logger == "thinned":
        every = np.arange(int(motion.duration * 1000.0 + 1e-6) + 1) / 1000.0
        return every[thin(every, encode(motion.displacement(every)), rows)]
    rate = max((r for r in _RATES_HZ if r * motion.duration < rows), default=_RATES_HZ[0])
    return np.arange(int(motion.duration * rate + 1e-6) + 1) / rate


def _law(scene: str, plan: Plan, rng: np.random.Generator) -> Law:
    elastic = "hertz" if scene in ("sticky", "air") else str(rng.choice(list(ELASTIC)))
    law = draw_law(elastic, str(rng.choice(list(RELAXATION))), rng, plan.depth)
    return stiffened(law, 0.0) if scene == "air" else law


def stiffened(law: Law, factor: float) -> Law:
    """Return a law with all forces a factor larger: the first constant of every curve sizes it."""
    return replace(law, curve=(law.curve[0] * factor, *law.curve[1:]))


def strengthened(effect: Effect, factor: float) -> Effect:
    """Return an effect with its strength a factor larger; a share stays below 1."""
    key = type(effect).recipe.size
    value = effect.parameters[key] * factor
    return replace(effect, **{key: min(value, 0.98) if key in effect.shares else value})
