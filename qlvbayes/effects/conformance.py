"""Check the rules that every effect has to keep, one by one or by one function."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace
from functools import cache, partial
from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np

from qlvbayes.effects.catalogue import EFFECTS, EVERY
from qlvbayes.effects.contacts import Adhesion
from qlvbayes.effects.effect import AbstractEffect, Level, Protocol
from qlvbayes.io.catalogue import Check, run_checks
from qlvbayes.laws.conformance import check_words
from qlvbayes.laws.elastic.exponential import Exponential
from qlvbayes.laws.layered import Contact, Law, Layer
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.relaxation.prony import Prony
from qlvbayes.laws.scales import Scales
from qlvbayes.priors import HalfNormal, Normal
from qlvbayes.priors.distributions import AbstractScalarPrior
from qlvbayes.xp import Array

_DRAWS = 24  # draws from the priors; every rule is checked at each
_REDUCED = 4  # draws at which a form is compared with its listed law, and looked at off the pad
_OFF = 2.0  # depths by which the platen of the tests is moved off the pad
_EXACT = 1e-12  # allowed error over the peak force
_SLIGHT = 1e-9  # share of an effect's size, at which the effect may move the force by no more than
_NEXT_TO_NOTHING = 1e-6  # this share of the peak force
_FAIR = (0.005, 0.25)  # median over the prior of the largest contribution, over the peak force

_RATES = (0.1, 1.0, 10.0, 20.0, 30.0, 100.0)  # mm/s
_STROKE, _ACCELERATION, _HOLD, _PAUSE = 1.6, 1000.0, 30.0, 120.0  # mm, mm/s2, s, s
_POINTS = 9  # points of a piece of constant acceleration
_SHOWING = Protocol(unloads=True, returns=True, tests=7, bonded=False, curved=True)


class EffectError(AssertionError):
    """Exception for an effect that breaks a rule; the text says which rule."""


def check_effect(kind: type[AbstractEffect], scales: Scales | None = None) -> None:
    """Check that an effect keeps the rules on which fits and comparisons of models rely.

    These are the rules:

    * it declares its name, units, null, law, what it looks like, and a reference;
    * it vanishes exactly at its null, and at a billionth of its size it changes next to nothing,
      except at a kink of the motion, where a force may jump;
    * its forces and their slopes are finite under its priors;
    * later motion changes no earlier force;
    * compiled, batched and plain evaluation agree, and its steps with them, where it has any;
    * it nests where no built-in effect of another family does, so that the order in which effects
      are added does not matter;
    * a form of a listed effect nests where that does, and has its law where it says so; one that
      acts off the pad, where that does not, nests outside the contact;
    * where the platen is off the pad it adds a force if and only if it says so;
    * its prior gives it a fair size.

    The tests are those of the paper and one that retracts fully. With ``scales`` they are stretched
    to its depth and force, and the size is not checked. An EffectError has a line for each rule
    that is broken.

    Parameters
    ----------
    kind, scales
        The effect's class; the scales of the tests, by default those of the paper.
    """
    run_checks(effect_checks(kind, scales), EffectError)


def effect_checks(kind: type[AbstractEffect], scales: Scales | None = None) -> Iterator[Check]:
    """Yield name and function of each check of `check_effect`, so that each is its own test.

    Parameters
    ----------
    kind, scales
        As there: ``@pytest.mark.parametrize(("name", "check"), effect_checks(MyEffect))``.
    """

    @cache
    def trial() -> _Trial:
        reference = _reference(*((scales.depth, scales.force) if scales else (_STROKE, 0.0)))
        return _Trial(kind.default(scales or reference.scales), reference)

    def declared() -> None:
        _check_declarations(kind)
        _check_amplitude(trial().default)

    yield "declarations", declared
    yield "nesting", partial(_check_nesting, kind)
    for name, check in _RULES.items():
        yield name, lambda check=check: check(trial())  # type: ignore[misc]
    if scales is None and kind.blind(_SHOWING) is None:
        yield "size", lambda: _check_size(trial())


@dataclass(frozen=True, eq=False)
class _Reference:
    """Reference tests, a baseline law, its forces (T, N) in N in these tests, and their scales."""

    motions: Motion
    law: Law
    baseline: np.ndarray
    scales: Scales

    @property
    def last(self) -> Motion:
        """Return the last test alone."""
        return jax.tree.map(lambda x: x[-1], self.motions)


class _Trial:
    """Effect with draws (D, P) of its free constants, and the same draws at its null."""

    def __init__(self, default: AbstractEffect, reference: _Reference) -> None:
        self.kind = type(default)
        self.default, self.reference = default, reference
        rng = np.random.default_rng(0)
        priors = {f.name: getattr(default, f.name) for f in fields(default)}
        self.free = [n for n, p in priors.items() if isinstance(p, AbstractScalarPrior)]
        draws = [[float(priors[name].draw(rng)) for name in self.free] for _ in range(_DRAWS)]
        self.draws = np.array(draws)
        self.nulls = self.draws.copy()
        for k, name in enumerate(self.free):
            if name in self.kind.null:
                self.nulls[:, k] = self.kind.null[name]
        self.run = jax.jit(self._forces_and_slopes)
        self.at_draws = [self.both(draw) for draw in self.draws]
        self.at_null = [self.both(null) for null in self.nulls]

    def both(self, constants: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return forces (T, N) and their slopes (P, T, N) in the reference's tests."""
        force, slopes = self.run(jnp.asarray(constants), self.reference.motions)
        return np.asarray(force), np.asarray(slopes)

    def values(self, constants: np.ndarray) -> str:
        """Return the constants as text."""
        return ", ".join(f"{n}={x:.3g}" for n, x in zip(self.free, constants, strict=True))

    def require_equal(self, found: Array, wanted: Array, words: str, most: float = _EXACT) -> None:
        """Raise an EffectError, in these words, unless two forces are equal."""
        error = np.max(np.abs(np.asarray(found) - wanted)) / self.reference.scales.force
        if not error <= most:
            name = self.kind.name + (" " if words[0] != ":" else "")
            raise EffectError(f"{name}{words} {error:.1e} of the peak")

    def law(self, constants: Array) -> Law:
        """Return the baseline law with the effect, and with contact where the model has it."""
        given = dict(zip(self.free, constants, strict=True))
        return self.law_with(
            self.kind(**{f.name: getattr(self.default, f.name) for f in fields(self.kind)} | given)
        )

    def law_with(self, effect: AbstractEffect, bonded: bool = False) -> Law:
        """Return the baseline law with an effect whose constants are numbers."""
        layers: tuple[Layer, ...] = (Contact(), effect)
        if bonded or isinstance(effect, Adhesion):
            layers = (effect,)
        elif effect.level < Level.CONTACT:
            layers = (effect, Contact())
        return Law(self.reference.law.elastic, self.reference.law.relaxation, layers)

    def forces(self, constants: Array, motions: Motion) -> Array:
        """Return the forces (T, N) in N."""
        return jax.vmap(self.law(constants).force)(motions)

    def _forces_and_slopes(self, constants: Array, motions: Motion) -> tuple[Array, Array]:
        def slope(direction: Array) -> Array:
            return jax.jvp(lambda x: self.forces(x, motions), (constants,), (direction,))[1]

        return self.forces(constants, motions), jax.vmap(slope)(jnp.eye(constants.shape[0]))


def _check_declarations(kind: type[AbstractEffect]) -> None:
    own = {field.name for field in fields(kind)}
    check_words(kind, own, ("units",), ("law", "seen", "reference"), EffectError)
    if not kind.name.isidentifier() or kind.name != kind.name.lower():
        raise EffectError(f"{kind.__name__}: the name {kind.name!r} is not lower case with _ only")
    if not own:
        raise EffectError(f"{kind.name} has no constants: give it one field each")
    if not kind.null or not set(kind.null) <= own:
        raise EffectError(f"{kind.name}: null must name one or more of its constants {_list(own)}")
    if kind.outside and kind.generalises:
        raise EffectError(f"{kind.name} names nothing, and cannot generalise {kind.generalises}")
    if kind.reduces and not kind.generalises:
        raise EffectError(f"{kind.name}: reduces to what? generalises must name a listed effect")
    if kind.generalises:
        _check_general(kind, own)


def _check_general(kind: type[AbstractEffect], own: set[str]) -> None:
    listed = _listed(kind)
    shared = {field.name for field in fields(listed)}
    if not shared <= own or next(iter(kind.null)) != next(iter(listed.null)):
        raise EffectError(
            f"{kind.name} must have the constants of {listed.name}, {_list(shared)}, and its "
            "amplitude, by the same names"
        )
    outer = _is_outer(kind, listed)
    if not (kind.reduces or outer) or not set(kind.reduces) <= own - shared:
        raise EffectError(
            f"{kind.name}: reduces must say where it is {listed.name}, by one or more of "
            f"{_list(own - shared)}"
        )
    if outer and kind.level < Level.CONTACT:
        raise EffectError(f"{kind.name} acts off the pad: it must nest outside the contact")
    if not outer and (kind.level, kind.rank) != (listed.level, listed.rank):
        raise EffectError(f"{kind.name} must nest where {listed.name} does: give it that rank")


def _is_outer(kind: type[AbstractEffect], listed: type[AbstractEffect]) -> bool:
    """Return whether a form acts off the pad and the listed effect does not."""
    return kind.off_pad and not listed.off_pad


def _listed(kind: type[AbstractEffect]) -> type[AbstractEffect]:
    """Return the listed effect that ``kind`` generalises."""
    for other in EFFECTS:
        if other.name == kind.generalises:
            return other
    raise EffectError(f"{kind.name} generalises {kind.generalises!r}, which is no listed effect")


def _list(names: set[str]) -> str:
    return ", ".join(sorted(names))


def _check_nesting(kind: type[AbstractEffect]) -> None:
    others = (other for other in EVERY if other.family() != kind.family())
    for other in others:
        if (other.level, other.rank) == (kind.level, kind.rank):
            raise EffectError(
                f"{kind.name} nests where {other.name} does, so that the order in which they are "
                "added would matter: give it another rank"
            )


def _check_amplitude(default: AbstractEffect) -> None:
    amplitude = next(iter(default.null))
    if not isinstance(getattr(default, amplitude), (HalfNormal, Normal)):
        raise EffectError(
            f"{default.name}: the default of its amplitude {amplitude} must come from "
            "scales.positive or scales.signed"
        )


def _check_null(trial: _Trial) -> None:
    for constants, (force, _) in zip(trial.nulls, trial.at_null, strict=True):
        trial.require_equal(
            force,
            trial.reference.baseline,
            f"does not vanish at its null: with {trial.values(constants)} the force is off by",
        )


def _check_slight(trial: _Trial) -> None:
    acceleration = np.asarray(trial.reference.motions.acceleration)
    smooth = np.diff(acceleration, axis=1, prepend=acceleration[:, :1]) == 0.0
    for draw, null, (nothing, _) in zip(trial.draws, trial.nulls, trial.at_null, strict=True):
        force, _ = trial.both(null + _SLIGHT * (draw - null))
        words = f"jumps: with a billionth of {trial.values(draw)} the force is off by"
        trial.require_equal(force[smooth], nothing[smooth], words, _NEXT_TO_NOTHING)


def _check_finite(trial: _Trial) -> None:
    points = [*trial.draws, *trial.nulls]
    for constants, (force, slopes) in zip(points, trial.at_draws + trial.at_null, strict=True):
        every = {"the force": force}
        every |= {f"the slope along {n}": x for n, x in zip(trial.free, slopes, strict=True)}
        for what, values in every.items():
            if not np.all(np.isfinite(values)):
                raise EffectError(
                    f"{trial.kind.name}: {what} is not finite with {trial.values(constants)}"
                )


def _check_causal(trial: _Trial) -> None:
    motions = trial.reference.motions
    points = motions.time.shape[1]
    for last in range(_POINTS // 2, points - 1, points // 8):
        later = jnp.arange(points) > last
        changed = replace(
            motions,
            displacement=jnp.where(later, 0.7 * motions.displacement, motions.displacement),
            velocity=jnp.where(later, -motions.velocity, motions.velocity),
            acceleration=jnp.where(later, 2.0 * motions.acceleration, motions.acceleration),
        )
        before = slice(None), slice(last + 1)
        trial.require_equal(
            trial.run(jnp.asarray(trial.draws[0]), changed)[0][before],
            trial.at_draws[0][0][before],
            "is not causal: later motion changes the force before it by",
        )


def _check_compiled(trial: _Trial) -> None:
    plain = trial.law(jnp.asarray(trial.draws[0])).force(trial.reference.last)
    words = ": compiled and plain evaluation differ by"
    trial.require_equal(plain, trial.at_draws[0][0][-1], words)


def _check_batched(trial: _Trial) -> None:
    batched = jax.jit(jax.vmap(trial.forces, in_axes=(0, None)))
    together = batched(jnp.asarray(trial.draws), trial.reference.motions)
    alone = np.stack([force for force, _ in trial.at_draws])
    words = ": a batch of constants and one at a time differ by"
    trial.require_equal(together, alone, words)


def _check_reduces(trial: _Trial) -> None:
    kind = trial.kind
    if not kind.generalises:
        return
    listed = _listed(kind)
    shared = [field.name for field in fields(listed)]
    bonded = _is_outer(kind, listed)  # there nothing is cut between the two places

    @jax.jit
    def both(values: dict[str, float]) -> list[Array]:
        of_listed = {name: values[name] for name in shared}
        laws = trial.law_with(kind(**values), bonded), trial.law_with(listed(**of_listed), bonded)
        return [jax.vmap(law.force)(trial.reference.motions) for law in laws]

    fixed = {field.name: getattr(trial.default, field.name) for field in fields(kind)}
    for draw in trial.draws[:_REDUCED]:
        values = fixed | dict(zip(trial.free, draw, strict=True)) | kind.reduces
        words = f"is not {listed.name} at {kind.reduces}: with {trial.values(draw)}"
        general, special = both(values)
        trial.require_equal(general, special, f"{words} the force is off by")


def _check_off_pad(trial: _Trial) -> None:
    motions, said = trial.reference.motions, trial.kind.off_pad
    place = motions.displacement - _OFF * trial.reference.scales.depth
    away = replace(motions, displacement=place)
    forces = [trial.run(jnp.asarray(draw), away)[0] for draw in trial.draws[:_REDUCED]]
    largest = float(np.max(np.abs(forces))) / trial.reference.scales.force
    if (largest > _EXACT) != said:
        raise EffectError(
            f"{trial.kind.name} says off_pad = {said}, and where the platen is off the pad it adds "
            f"{largest:.1e} of the peak"
        )


def _check_steps(trial: _Trial) -> None:
    if trial.kind.step is AbstractEffect.step:
        return
    motion = trial.reference.last
    duration, travel = jnp.diff(motion.time), jnp.diff(motion.displacement)
    moving = duration > 0.0
    speeds = jnp.where(moving, travel / jnp.where(moving, duration, 1.0), 0.0)
    lines = Line(duration, motion.displacement[1:], speeds, jnp.zeros_like(duration))
    velocity = jnp.concatenate([jnp.zeros(1), speeds])
    still, start = jnp.zeros_like(velocity), -motion.time[0]
    broken = replace(motion, velocity=velocity, acceleration=still, start=start)
    law = trial.law(jnp.asarray(trial.draws[0]))
    stepped = _stepped(law, motion.displacement[0], lines)
    words = ": steps and the force of a whole motion differ by"
    trial.require_equal(stepped, law.force(broken)[1:], words)


@jax.jit
def _stepped(law: Law, first: Array, lines: Line) -> Array:
    """Return the forces (N,) in N at the ends of lines (N,), from the first point on."""
    return jax.lax.scan(lambda state, line: law.step(state, line), law.begin(first), lines)[1]


def _check_size(trial: _Trial) -> None:
    low, high = _FAIR
    forces = np.array([force for force, _ in trial.at_draws])
    largest = np.max(np.abs(forces - trial.reference.baseline), axis=(1, 2))
    size = float(np.median(largest)) / trial.reference.scales.force
    if not low <= size <= high:
        raise EffectError(
            f"{trial.kind.name}: under its prior it changes the force by {size:.2%} of the peak "
            f"(median), not {low:.1%} to {high:.0%}; give scales.positive or scales.signed what "
            "one unit of the amplitude adds to the force at most"
        )


_RULES: dict[str, Callable[[_Trial], None]] = {
    "null": _check_null,
    "finite": _check_finite,
    "slight": _check_slight,
    "causal": _check_causal,
    "compiled": _check_compiled,
    "batched": _check_batched,
    "listed law": _check_reduces,
    "off the pad": _check_off_pad,
    "steps": _check_steps,
}


@cache
def _reference(depth: float, force: float) -> _Reference:
    """Return tests to ``depth`` (mm) of a pad like the paper's pad B."""
    stretch = depth / _STROKE
    tests, clock = [], 0.0
    for rate in _RATES:
        tests.append((clock, _sampled([(_STROKE, rate), (_STROKE / 2.0, 1.0)])))
        clock += tests[-1][1][0][-1] + _PAUSE
    tests.append((clock, _sampled([(_STROKE, 20.0), (0.0, 20.0)])))
    points = max(test[1][0].size for test in tests)
    padded = [[np.pad(x, (0, points - x.size), mode="edge") for x in test] for _, test in tests]
    time, d, v, a = (jnp.asarray(np.stack(x)) for x in zip(*padded, strict=True))
    starts = jnp.array([start for start, _ in tests])
    indices = jnp.arange(float(len(tests)))
    motions = Motion(time, stretch * d, stretch * v, stretch * a, starts, number=indices)
    prony = Prony(jnp.array([0.2955, 0.63, 0.0745]), jnp.array([6.2, 0.14]))
    law = Law(Exponential(0.34 / stretch, 1.165 / stretch), prony, (Contact(),))
    baseline = np.asarray(jax.vmap(law.force)(motions))
    if force > 0.0:
        factor = force / float(baseline.max())
        law = replace(law, elastic=Exponential(0.34 / stretch * factor, 1.165 / stretch))
        baseline = baseline * factor
    scales = Scales(
        force=float(baseline.max()),
        depth=depth,
        shortest=1e-3,
        longest=_HOLD,
        white=1e-3,
        ou=1e-3,
        tau=1.0,
        speed=float(jnp.max(jnp.abs(motions.velocity))),
        acceleration=float(jnp.max(jnp.abs(motions.acceleration))),
        clock=float(starts[-1] + motions.time[-1, -1]),
        stiffness=float(law.elastic.stiffness(jnp.asarray(depth))),
    )
    return _Reference(motions, law, baseline, scales)


def _sampled(moves: list[tuple[float, float]]) -> list[np.ndarray]:
    """Return time, displacement, velocity and acceleration of moves, with a hold after each."""
    pieces: list[tuple[float, float, float, float]] = []  # duration, displacement, v, a
    position = 0.0
    for target, speed in moves:
        distance, sign = abs(target - position), math.copysign(1.0, target - position)
        top = min(speed, math.sqrt(_ACCELERATION * distance))
        rise = top / _ACCELERATION
        run_up = 0.5 * top * rise
        pieces.append((rise, position, 0.0, sign * _ACCELERATION))
        if distance > 2.0 * run_up * (1.0 + 1e-9):
            pieces.append(
                ((distance - 2.0 * run_up) / top, position + sign * run_up, sign * top, 0.0)
            )
        pieces.append((rise, target - sign * run_up, sign * top, -sign * _ACCELERATION))
        pieces.append((_HOLD, target, 0.0, 0.0))
        position = target
    starts = np.cumsum([0.0, *(piece[0] for piece in pieces)])
    columns: list[list[np.ndarray]] = []
    shares = np.arange(_POINTS) / _POINTS
    for (start, _), (duration, d, v, a) in zip(pairwise(starts), pieces, strict=True):
        t = duration * (shares if v or a else shares**3)
        columns.append([start + t, d + v * t + 0.5 * a * t**2, v + a * t, np.full_like(t, a)])
    columns.append([np.array([x]) for x in (starts[-1], position, 0.0, 0.0)])
    return [np.concatenate(x) for x in zip(*columns, strict=True)]
