"""Lifelike pads: never exactly what any model says, on a rig that is never quite known.

Every study has a part that no listed effect is, of 0.3 to 3 % of the peak force; its stiffness and
the strengths of its hidden effects scatter from test to test; its motion is limited in jerk; its
tests share one contact, and the zero that is given for it is wrong by up to 20 um.

An effect can be seen if its force at its mean strength, less what hides it, is at least three times
the unlisted part's, less the same, and three times the noise of a phase mean: root mean squares
over the effect's own phases, which are those in which it has at least half of its largest root mean
square of a phase. What hides it is the best fit by the law's constants, by a scale of each test
within the scatter of the stiffness, and by a contact within its error. It is drawn to have 3 to 12
times as much; where a programme or an unlisted part leaves no room for that below 40 % of the peak,
others are drawn.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from lifelike_rig import (
    PROGRAMMES,
    UNLISTED,
    UNLISTED_IN_AIR,
    JerkLimited,
    Plan,
    draw_air_plan,
    draw_plan,
    kind_of,
)
from numpy.typing import NDArray

from qlvbayes.evaluation.lists import PRESENT
from qlvbayes.evaluation.population import kin
from qlvbayes.io.data import Pad, Test
from qlvbayes.io.units import PAD
from qlvbayes.simulate import ENCODER_STEP, Effect, HiddenPad, Hold, Move, Step, encode, thin
from qlvbayes.simulate.hidden import NearContact
from qlvbayes.simulate.hidden.recipes import Draw
from qlvbayes.simulate.laws import ELASTIC, RELAXATION, Law, draw_law, log_uniform
from qlvbayes.simulate.loadcell import LoadCell

Array = NDArray[np.float64]

BLOCK = ("none",) * 5 + ("single",) * 10 + ("air", "sticky") + ("double",) * 3
"""What is hidden in twenty studies: nothing, a listed effect, a mass alone in air, an adhesion that
grows with the press on a Hertzian pad, two listed effects."""
UNLISTED_SHARE = (0.003, 0.03)  # of the peak, rms over the moving and held parts
SPREAD = 0.4  # largest sd of the logarithm of an effect's strength from test to test,
STIFFNESS_SPREAD = 0.1  # and of the stiffness's
CONTACT_MM = 0.02  # largest error of the given zero
NOISE = (2e-4, 1e-2)  # sd over the peak
SEEN = 3.0  # times the unlisted part and the noise of a phase mean
_STRONGEST = 12.0  # the same, as drawn
_LARGEST = 0.4  # of the peak, that an effect may have anywhere
_WIDTH_MM = (0.001, 0.005)  # within which contact comes about
_WIDTHS = 4.0  # before the contact, where this begins
_ROWS = (2500, 5500)  # of all tests
_RATES_HZ = (10.0, 20.0, 25.0, 50.0, 100.0, 200.0, 250.0, 500.0, 1000.0)
_HOLD_S = {"thinned": 30.0, "uniform": 6.0}
_CREEP_MM = 4e-4
_PAUSE_S = 120.0
_AIR_N = (0.1, 1.0)  # largest force on the mass
_AIR_SPREAD = 0.05  # a mass stays what it is; its motion is not quite known
_ATTEMPTS = 6
_ROUNDS = 8  # of scaling an effect
_CLOSE = 0.03
_CELLS, _DRAWING_CELLS = 120, 30  # of the solver in a stretch
_STEP = 1e-3  # of a constant's logarithm
_SHIFT_MM = 1e-3  # of the contact


@dataclass(frozen=True)
class Item:
    """What one study of a seed hides: an entry of `BLOCK`, and the names."""

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
class Rig:
    """Motion, clocks and sensors of one study.

    contact: where the pad is touched, in the coordinate of the file, mm; width: within which, mm;
    times: sampled times of every test, s.
    """

    plan: Plan
    contact: float
    width: float
    motions: dict[str, JerkLimited]
    logger: str
    times: tuple[Array, ...]

    @cached_property
    def phases(self) -> list[Array]:
        """The phase of every sample, numbered over all tests."""
        found, first = [], 0
        for motion, t in zip(self.motions.values(), self.times, strict=True):
            begins = [begin for begin, _ in motion.phases]
            found.append(first + np.searchsorted(begins, t, side="right") - 1)
            first += len(begins)
        return found

    @cached_property
    def on_pad(self) -> list[JerkLimited]:
        """The motions in the coordinate of the pad, in which contact is complete at _WIDTHS."""
        by = _WIDTHS * self.width - self.contact
        return [motion.shifted(by) for motion in self.motions.values()]

    def forces(self, pads: Sequence[HiddenPad]) -> list[Array]:
        """Return the true force (N) of each test's pad at all samples."""
        some = zip(pads, self.on_pad, self.times, strict=True)
        return [pad.force(motion, t) for pad, motion, t in some]

    def rms(self, forces: Sequence[Array]) -> Array:
        """Return the root mean square of every phase."""
        phase, square = np.concatenate(self.phases), np.concatenate(list(forces)) ** 2
        return np.sqrt(np.bincount(phase, square) / np.maximum(np.bincount(phase), 1))


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
            pads.append(_pad(law, self.rig, [*(own if effects else ()), *extra], _CELLS))
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
    bare = rig.forces([_pad(law, rig, (), _DRAWING_CELLS)] * count)
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
    scales = _Scales(law, rig, bare, peak, cell, stiffness_spread, rng)
    unlisted, shared = scales.unlisted(UNLISTED_IN_AIR if air else UNLISTED)
    effects, seen, left = [], {}, {}
    for one in what.names:
        hidden = "adhesion_at_a_stretch" if what.scene == "sticky" else one
        effect, seen[one], left[one] = scales.listed(hidden, shared, air)
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
    return _measured(study, name, scales.share, rng)


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
        times.append(_sampled(motion, logger, rows))
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


def _sampled(motion: JerkLimited, logger: str, rows: int) -> Array:
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
    """Return a law with all forces a factor larger: the first constant of every curve scales it."""
    return replace(law, curve=(law.curve[0] * factor, *law.curve[1:]))


def strengthened(effect: Effect, factor: float) -> Effect:
    """Return an effect with its strength a factor larger; a share stays below 1."""
    key = type(effect).recipe.size
    value = effect.parameters[key] * factor
    return replace(effect, **{key: min(value, 0.98) if key in effect.shares else value})


def _pad(
    law: Law, rig: Rig, effects: Sequence[Effect], cells: int, shift: float = 0.0
) -> HiddenPad:
    """Return the pad; its contact may come later by a shift (mm)."""
    near = NearContact(_WIDTHS * rig.width + shift, rig.width)
    settled = 1e-7 if cells == _CELLS else 1e-5
    return HiddenPad(law, (near, *effects), cells=cells, frame_speed=True, settled=settled)


class _Scales:
    """Draws effects of a wanted size in the tests of one pad."""

    def __init__(
        self, law: Law, rig: Rig, bare: list[Array], peak: float, cell: LoadCell, spread: float,
        rng: np.random.Generator,
    ) -> None:  # fmt: skip
        self.law, self.rig, self.bare, self.peak, self.rng = law, rig, bare, peak, rng
        self.spread = spread
        self.share = log_uniform(rng, *UNLISTED_SHARE)
        motions = list(rig.motions.values())
        own = law.v if len(law.v) <= 3 else ()
        end = motions[-1].start_s + motions[-1].duration
        self.draw = Draw(rng, peak, rig.plan.depth, tuple(own), end)
        self.noise = _mean_noise(rig, cell)

    @cached_property
    def slopes(self) -> Array:
        """Weighted changes of the force (N) with what hides an effect, (n + k, k).

        These are the logarithms of the law's constants, a scale of each test, and the contact; the
        last k rows say how far each of them may go before it costs as much as the unlisted part.
        """
        columns, allowed = [], []
        for k, value in enumerate(self.law.constants):
            moved = list(self.law.constants)
            moved[k] = value * (1.0 + _STEP)
            changed = self._changed(self.law.with_constants(tuple(moved)), 0.0)
            columns.append(changed / _STEP)
            allowed.append(np.inf)
        for k in range(len(self.bare)):
            own = [one if n == k else np.zeros_like(one) for n, one in enumerate(self.bare)]
            columns.append(np.concatenate(own))
            allowed.append(max(self.spread, _STEP))
        columns.append(self._changed(self.law, _SHIFT_MM) / _SHIFT_MM)
        allowed.append(CONTACT_MM / 3.0**0.5)
        weighted = np.column_stack(columns) * self.weights[:, None]
        return np.vstack([weighted, np.diag(self.share * self.peak / np.array(allowed))])

    def _changed(self, law: Law, shift: float) -> Array:
        """Return the change of the force (N) with another law or a later contact (mm)."""
        pads = [_pad(law, self.rig, (), _DRAWING_CELLS, shift)] * len(self.bare)
        return np.concatenate(self.rig.forces(pads)) - np.concatenate(self.bare)

    @cached_property
    def weights(self) -> Array:
        """Equal weights of all phases."""
        phase = np.concatenate(self.rig.phases)
        return 1.0 / np.sqrt(np.bincount(phase)[phase])

    def pattern(self, effect: Effect) -> Array:
        """Return the effect's own force (N), all tests in a row."""
        pads = [_pad(self.law, self.rig, (effect,), _DRAWING_CELLS)] * len(self.bare)
        return np.concatenate(self.rig.forces(pads)) - np.concatenate(self.bare)

    def left(self, pattern: Array) -> Array:
        """Return the root mean square of every phase of what nothing takes that hides it."""
        if self.law.curve[0] == 0.0:  # air has no constants
            return self.rig.rms([pattern])
        slopes, count = self.slopes, pattern.size
        wanted = np.append(pattern * self.weights, np.zeros(slopes.shape[1]))
        x, *_ = np.linalg.lstsq(slopes, wanted, rcond=None)
        return self.rig.rms([pattern - (slopes[:count] @ x) / self.weights])

    def unlisted(self, kinds: Sequence[str]) -> tuple[Effect, Array]:
        """Draw the unlisted part; what nothing takes of it that hides effects, by phase."""
        wanted = self.share * self.peak
        for kind in self.rng.permutation(kinds).tolist():
            effect, pattern = self._sized(
                kind, lambda p: float(np.sqrt(np.mean(self.rig.rms([p]) ** 2))) / wanted
            )
            share = float(np.sqrt(np.mean(self.rig.rms([pattern]) ** 2))) / wanted
            if abs(share - 1.0) < 3.0 * _CLOSE:
                return effect, self.left(pattern)
        raise RuntimeError("no unlisted part has the wanted size")

    def listed(
        self, name: str, unlisted: Array, air: bool
    ) -> tuple[Effect, float, tuple[float, float, float]]:
        """Draw a listed effect; how many times it exceeds what hides it, and what it leaves."""
        target = log_uniform(self.rng, SEEN * (1.0 + 2.0 * _CLOSE), _STRONGEST)

        def excess(pattern: Array) -> float:
            largest = float(np.abs(pattern).max()) / self.peak
            if air:
                return largest
            return max(self._compared(pattern, unlisted)[0] / target, largest / _LARGEST)

        effect, pattern = self._sized(name, excess)
        seen, left = self._compared(pattern, unlisted)
        return effect, seen, left

    def _compared(
        self, pattern: Array, unlisted: Array
    ) -> tuple[float, tuple[float, float, float]]:
        own = self.left(pattern)
        acts = own >= 0.5 * own.max()
        parts = [float(np.sqrt(np.mean(one[acts] ** 2))) for one in (own, unlisted, self.noise)]
        size, other, noise = (part / self.peak for part in parts)
        return size / max(other, noise), (size, other, noise)

    def _sized(self, name: str, measure: Callable[[Array], float]) -> tuple[Effect, Array]:
        """Return an effect, and its force, whose measure is 1: secants in the logarithms."""
        cls = kind_of(name)
        recipe, sign = cls.recipe, 1.0
        if recipe.size in cls.signed:
            sign = float(self.rng.choice([-1.0, 1.0]))
        unit, shape = sign * recipe.per(self.draw), recipe.shape(self.draw)
        value, power, before = recipe.guess, 1.0, None
        for _ in range(_ROUNDS):
            effect = cls(**{recipe.size: float(unit * value), **shape})
            pattern = self.pattern(effect)
            found = measure(pattern)
            if found <= 0.0 or abs(found - 1.0) < _CLOSE:
                break
            if before is not None and before[0] != value:
                power = float(np.log(found / before[1]) / np.log(value / before[0]))
            before = value, found
            step = found ** (-1.0 / min(max(power, 0.3), 3.0))
            value = min(value * min(max(step, 0.05), 20.0), recipe.cap)
            if value == before[0]:
                break
        return effect, pattern


def _mean_noise(rig: Rig, cell: LoadCell) -> Array:
    """Return the standard deviation (N) of the mean of every phase's noise."""
    sds = []
    for phase, t in zip(rig.phases, rig.times, strict=True):
        for k in range(phase[0], phase[-1] + 1):
            own = t[phase == k]
            memory = np.exp(-np.abs(own[:, None] - own) / cell.time).mean() if own.size else 1.0
            variance = cell.white**2 / max(own.size, 1) + cell.correlated**2 * memory
            sds.append(float(np.sqrt(variance)))
    return np.array(sds)
