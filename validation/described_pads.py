"""Pads with one mechanism that no list holds, and fresh tests of the same pads.

A study presses one pad as the paper does or by another programme, on a rig of limited jerk. It
hides nothing, a listed effect, or an outsider: one that no listed effect is, of 2 to 8 % of the
peak force after the law's constants, a scale of each test and the contact have taken what they can.
The fresh tests follow the others on the pad's clock, at speeds between those of the record and at
0.9 and 0.75 of its depths; their forces are known without noise.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from blind.laws import ELASTIC, RELAXATION, Law, draw_law, log_uniform
from blind.lists import PRESENT
from blind.loadcell import LoadCell
from lifelike_pads import sampled
from lifelike_rig import PROGRAMMES, JerkLimited, Plan, draw_plan, kind_of
from lifelike_sizes import CELLS, CONTACT_MM, Rig, Sizes, pad_of
from numpy.typing import NDArray

from qlvbayes.io.data import Pad, Test
from qlvbayes.io.units import PAD
from qlvbayes.simulate import ENCODER_STEP, Effect, Move, Step, encode
from qlvbayes.simulate.hidden.effect import Recipe, stiffness_of
from qlvbayes.simulate.hidden.mesh import Path

Array = NDArray[np.float64]

BLOCK = ("outsider",) * 6 + ("none",) * 4 + ("listed",) * 4
"""What is hidden in fourteen studies."""
OUTSIDERS = (
    "bubble", "cracking_skin", "rolling_specimen", "swelling", "drive_warmth", "curing",
    "viscous_heating", "snap_through", "stick_slip", "slow_swelling", "second_material",
    "rough_stop",
)  # fmt: skip
"""Mechanisms that no listed effect is."""
SHARE = (0.02, 0.08)  # of the peak: root mean square of what hides the outsider least
_NOISE = (3e-4, 3e-3)  # sd over the peak
_ROWS = (2000, 3500)  # of all tests
_HOLD_S = {"thinned": 30.0, "uniform": 6.0}
_PAUSE_S = 120.0
_WIDTH_MM = (0.001, 0.005)
_DEEP = (0.9, 0.75)  # of the record's depths, in the fresh tests
_FRESH = 3
_ATTEMPTS = 8


@dataclass(frozen=True)
class RoughStop(Effect):
    """F -> F + stiffness max(d - depth, 0) (1 + friction way): a rubbing stop; N/mm, mm.

    way is the direction of the last motion, -1 or 1.
    """

    name: ClassVar[str] = "rough_stop"
    recipe: ClassVar[Recipe] = Recipe(
        "stiffness",
        per=stiffness_of,
        shape=lambda x: {"depth": x.depth * x.even(0.4, 0.7), "friction": x.even(0.2, 0.6)},
    )
    order: ClassVar[int] = 39
    positive: ClassVar[tuple[str, ...]] = ("depth",)
    shares: ClassVar[tuple[str, ...]] = ("friction",)

    stiffness: float
    depth: float
    friction: float

    def on_force(self, force: Array, path: Path) -> Array:
        """Add the stop's force."""
        travel = np.diff(path.depth.ravel(), prepend=path.depth.flat[0])
        moved = np.where(travel != 0.0, np.arange(travel.size), 0)
        way = np.sign(travel[np.maximum.accumulate(moved)]).reshape(force.shape)
        pressed = np.maximum(path.depth - self.depth, 0.0)
        return force + self.stiffness * pressed * (1.0 + self.friction * way)


def kind(name: str) -> type[Effect]:
    """Return the class of a hidden effect, by its name."""
    return RoughStop if name == RoughStop.name else kind_of(name)


@dataclass(frozen=True, eq=False)
class Study:
    """One study with its truth; ``fresh`` are tests of the same pad without noise."""

    scene: str
    hidden: str
    law: Law
    effect: Effect | None
    share: float  # of the peak force, that the outsider leaves
    noise: float  # N
    plan: Plan
    pad: Pad
    fresh: tuple[Test, ...]


def item(seed: int, index: int) -> tuple[str, str, bool]:
    """Return scene, name of what is hidden, and whether the rig is the paper's."""
    block, place = divmod(index, len(BLOCK))
    number = int(_stream(seed, block, "described").permutation(len(BLOCK))[place])
    scene, paper = BLOCK[number], (number + block) % 2 == 0
    if scene == "none":
        return scene, "", paper
    names = OUTSIDERS if scene == "outsider" else PRESENT.listed
    turn, k = divmod(block * BLOCK.count(scene) + number - BLOCK.index(scene), len(names))
    return scene, str(_stream(seed, turn, scene).permutation(names)[k]), paper


def _stream(seed: int, number: int, word: str) -> np.random.Generator:
    return np.random.default_rng([seed, number, *word.encode()])


def make_study(seed: int, index: int) -> Study:
    """Simulate one study; a draw in which the mechanism cannot have its size is drawn again."""
    scene, hidden, paper = item(seed, index)
    for attempt in range(_ATTEMPTS):
        rng = np.random.default_rng([seed, index, attempt, *b"described study"])
        try:
            return _drawn(scene, hidden, paper, f"study {index}", rng)
        except RuntimeError:  # the solver finds no balance, or no size fits
            continue
    raise RuntimeError("the simulation stopped in every draw")


def _drawn(scene: str, hidden: str, paper: bool, name: str, rng: np.random.Generator) -> Study:
    logger = str(rng.choice(list(_HOLD_S)))
    programme = "paper" if paper else str(rng.choice([p for p in PROGRAMMES if p != "paper"]))
    plan = draw_plan(programme, _HOLD_S[logger], rng)
    contact = float(rng.uniform(-CONTACT_MM, CONTACT_MM))
    width, rows = float(rng.uniform(*_WIDTH_MM)), int(rng.uniform(*_ROWS))
    rig = _rig(plan, logger, contact, width, rows, 0.0, 0)
    law = draw_law(
        str(rng.choice(list(ELASTIC))), str(rng.choice(list(RELAXATION))), rng, plan.depth
    )
    bare = rig.forces([pad_of(law, rig, ())] * len(rig.motions))
    peak = max(float(force.max()) for force in bare)
    noise, white = peak * log_uniform(rng, *_NOISE), float(rng.uniform(0.3, 0.95))
    cell = LoadCell(
        white=white * noise, correlated=(1.0 - white**2) ** 0.5 * noise,
        time=log_uniform(rng, 0.2, 1.5), encoder=ENCODER_STEP,
    )  # fmt: skip
    effect, share = None, 0.0
    if hidden:
        effect, share = _sized(hidden, law, rig, bare, peak, cell, rng)
    effects = (effect,) if effect else ()
    last = list(rig.motions.values())[-1]
    later = _rig(
        _fresh(plan), logger, contact, width, rows // 2, last.start_s + last.duration + _PAUSE_S,
        len(rig.motions),
    )  # fmt: skip
    tests = [
        _tests(one, law, effects, name, cell if one is rig else None, rng) for one in (rig, later)
    ]
    return Study(scene, hidden, law, effect, share, noise, plan, Pad(name, tests[0], PAD), tests[1])


def _rig(
    plan: Plan, logger: str, contact: float, width: float, rows: int, clock: float, number: int
) -> Rig:
    motions: dict[str, JerkLimited] = {}
    times = []
    for k, (name, program) in enumerate(plan.programs.items()):
        motion = JerkLimited(program, plan.jerk, -plan.lead, clock, number + k)
        motions[name] = motion
        times.append(sampled(motion, logger, rows // len(plan.programs)))
        clock += motion.duration + _PAUSE_S
    return Rig(plan, contact, width, motions, logger, tuple(times))


def _fresh(plan: Plan) -> Plan:
    """Return tests at other speeds and depths: between neighbours of those that were made."""
    names = list(plan.programs)
    chosen = [names[k] for k in np.linspace(0, len(names) - 2, _FRESH).round().astype(int)]
    programs: dict[str, tuple[Step, ...]] = {}
    for k, name in enumerate(chosen):
        after = plan.programs[names[names.index(name) + 1]]
        programs[f"fresh-{k + 1}"] = tuple(
            _between(one, other, _DEEP[k % len(_DEEP)])
            for one, other in zip(plan.programs[name], (*after, *plan.programs[name]), strict=False)
        )
    return replace(plan, programs=programs)


def _between(step: Step, other: Step, deep: float) -> Step:
    """Return a move to a share of its depth, at the geometric mean of two speeds."""
    if not isinstance(step, Move):
        return step
    speed = (step.speed * other.speed) ** 0.5 if isinstance(other, Move) else 0.8 * step.speed
    return replace(step, target=step.target * deep, speed=speed)


def _sized(
    name: str, law: Law, rig: Rig, bare: list[Array], peak: float, cell: LoadCell,
    rng: np.random.Generator,
) -> tuple[Effect, float]:  # fmt: skip
    """Return a mechanism that leaves a drawn share of the peak, and that share."""
    sizes = Sizes(law, rig, bare, peak, cell, 0.0, rng)
    wanted = log_uniform(rng, *SHARE)
    recipe = kind(name).recipe
    unit, shape = recipe.per(sizes.draw), recipe.shape(sizes.draw)
    value = recipe.guess if np.isfinite(recipe.guess) else 0.1
    for _ in range(8):
        value = min(value, recipe.cap)
        effect = kind(name)(**{recipe.size: float(unit * value), **shape})
        left = sizes.left(sizes.pattern(effect))
        share = float(np.sqrt(np.mean(left**2))) / peak
        if share <= 0.0:
            break
        if abs(share / wanted - 1.0) < 0.1 or (value == recipe.cap and share >= SHARE[0]):
            return effect, share
        value *= min(max(wanted / share, 0.1), 10.0)
    raise RuntimeError("no size fits")


def _tests(
    rig: Rig, law: Law, effects: tuple[Effect, ...], name: str, cell: LoadCell | None,
    rng: np.random.Generator,
) -> tuple[Test, ...]:  # fmt: skip
    """Return the tests of a rig; without a load cell their forces have no noise."""
    forces = rig.forces([pad_of(law, rig, effects, CELLS)] * len(rig.motions))
    tests = []
    for (label, motion), t, force in zip(rig.motions.items(), rig.times, forces, strict=True):
        read = encode(motion.displacement(t), ENCODER_STEP)
        force = force if cell is None else force + cell.draw(t, rng)
        tests.append(Test(label, name, t, read, force, start_s=motion.start_s, start_known=True))
    return tuple(tests)
