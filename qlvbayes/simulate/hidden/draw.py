"""Hidden effects of chosen sizes: drawn at random, or from the words of a command line."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from math import log

import numpy as np

from qlvbayes.io.checks import InputError

from ..constants import TABLE_1, Constants
from ..motion import Motion
from ..platen import PAPER_RATES, Move, Platen, Step
from .catalogue import effect_class
from .effect import Draw, Effect, Protocol, Recipe
from .mesh import Array
from .pad import HiddenPad

_STROKE = 1.6  # mm, of the protocols
_PAUSE_S = 120.0  # between tests, as in the bundled sessions
_TRIAL_CELLS = 60  # of the solver in a stretch: a size need only be near
_ROUNDS = 8  # of scaling an effect to the size asked for
_MANY_PIECES = 50  # smooth motion: nothing happens at a kink
_EVEN_MOMENTS = 1000  # of a smooth test, at which an effect's size is taken
_CLOSE = 0.02  # of the size asked for
_SOON_S = np.linspace(0.0, 0.15, 16)


def draw_effect(
    kind: str | type[Effect],
    rng: np.random.Generator,
    pad_peak_force: float,
    depth: float,
    top_speed: float,
    size: float,
    constants: Constants | None = None,
    protocol: Protocol | None = None,
) -> Effect:
    """Draw an effect whose largest contribution to the force in a study is `size` of the peak."""
    cls = effect_class(kind) if isinstance(kind, str) else kind
    if not min(pad_peak_force, depth, top_speed, size) > 0 or not size < 1:
        raise InputError("peak force, depth, speed and size must be above 0, and size below 1")
    trial = _trial(constants, protocol or cls.recipe.protocols[0], pad_peak_force, depth, top_speed)
    draw = Draw(rng, trial.peak, depth, trial.pad.constants.v, trial.study_s)
    return _drawn(cls, draw, trial, size)


def draw_effect_in(
    kind: str | type[Effect],
    rng: np.random.Generator,
    pad: HiddenPad,
    motions: Sequence[Motion],
    size: float,
    rates: Sequence[float] = (),
) -> Effect:
    """Draw an effect whose largest contribution to these tests is `size` of the peak."""
    times = tuple(_moments(motion) for motion in motions)
    forces = tuple(pad.force(p, t) for p, t in zip(motions, times, strict=True))
    peak = max(float(f.max()) for f in forces)
    depth = max(float(p.displacement(t).max()) for p, t in zip(motions, times, strict=True))
    trial = _DrawnTests(pad, tuple(motions), times, forces, peak)
    cls = effect_class(kind) if isinstance(kind, str) else kind
    return _drawn(cls, Draw(rng, peak, depth, tuple(rates), trial.study_s), trial, size)


def _drawn(cls: type[Effect], draw: Draw, trial: _DrawnTests, size: float) -> Effect:
    recipe, rng = cls.recipe, draw.rng
    if recipe.known is not None:
        return cls(**{recipe.size: recipe.known(draw, size)})
    shape = recipe.shape(draw)
    sign = rng.choice([-1.0, 1.0]) if recipe.size in cls.signed else 1.0
    unit = recipe.per(draw)

    def build(value: float) -> Effect:
        return cls(**{recipe.size: float(sign * unit * value), **shape})

    return build(_sized(build, recipe, trial, size))


@dataclass(frozen=True)
class _DrawnTests:
    """Tests of a study, some moments of each, and the forces of the pad at them."""

    pad: HiddenPad
    platens: tuple[Motion, ...]
    times: tuple[Array, ...]
    forces: tuple[Array, ...]
    peak: float

    @property
    def study_s(self) -> float:
        """Clock at the end of the last test, s."""
        return self.platens[-1].start_s + self.platens[-1].duration

    def share(self, effect: Effect) -> float:
        """Largest contribution of the effect, as a share of the peak force."""
        pad = replace(self.pad, effects=(*self.pad.effects, effect))
        runs = zip(self.platens, self.times, self.forces, strict=True)
        return max(float(np.abs(pad.force(p, t) - f).max()) for p, t, f in runs) / self.peak


def _trial(
    constants: Constants | None, protocol: Protocol, peak: float, depth: float, top_speed: float
) -> _DrawnTests:
    stretch = depth / _STROKE
    own = constants or replace(TABLE_1["B"], b=TABLE_1["B"].b / stretch)
    platens: list[Platen] = []
    clock = 0.0
    for rate in (*(r for r in PAPER_RATES if r < top_speed), top_speed):
        program = tuple(_scaled(step, stretch) for step in protocol(rate))
        platens.append(Platen(program, start_s=clock, number=len(platens)))
        clock += platens[-1].duration + _PAUSE_S
    times = tuple(_moments(platen) for platen in platens)
    pad = HiddenPad(own, cells=_TRIAL_CELLS)
    forces = [pad.force(p, t) for p, t in zip(platens, times, strict=True)]
    top = max(float(f.max()) for f in forces)
    if constants is None:
        pad = replace(pad, constants=replace(own, m=own.m * peak / top))
        forces, top = [f * peak / top for f in forces], peak
    return _DrawnTests(pad, tuple(platens), times, tuple(forces), top)


def _scaled(step: Step, stretch: float) -> Step:
    return replace(step, target=step.target * stretch) if isinstance(step, Move) else step


def _moments(platen: Motion) -> Array:
    """Return times at which something may show: even in each piece, and soon after it began."""
    if len(platen.pieces) > _MANY_PIECES:
        return np.linspace(0.0, platen.duration, _EVEN_MOMENTS)
    shares = np.concatenate([[0.0], np.geomspace(1e-4, 0.03, 8), np.linspace(0.04, 0.999, 25)])
    times = [piece.start + shares * piece.duration for piece in platen.pieces]
    soon = np.concatenate([kink + _SOON_S for kink in platen.kinks])
    times.append(soon[soon < platen.duration])
    return np.unique(np.concatenate([*times, [platen.duration]]))


def _sized(
    build: Callable[[float], Effect], recipe: Recipe, trial: _DrawnTests, size: float
) -> float:
    """Value of the size parameter that gives the share `size`, or the cap if none does."""
    value = recipe.guess
    share = trial.share(build(value))
    before: tuple[float, float] | None = None
    for _ in range(_ROUNDS):
        if share <= 0.0 or abs(share / size - 1.0) < _CLOSE:
            break
        power = 1.0
        if before is not None and before[0] != value:
            power = log(share / before[1]) / log(value / before[0])
        before = value, share
        value = min(value * (size / share) ** (1.0 / min(max(power, 0.3), 3.0)), recipe.cap)
        if value == before[0]:
            break
        share = trial.share(build(value))
    return value


_SIZE = 0.06  # share of the peak force that an effect has unless the user says more: well seen


def parse_effect(
    text: str, constants: Constants, protocol: Protocol, top_speed: float, rng: np.random.Generator
) -> Effect:
    """Effect from 'name:parameter=value,...', or drawn at 6 % of the peak force from 'name'."""
    name, colon, words = (part.strip() for part in text.partition(":"))
    cls = effect_class(name)
    if colon:
        return _given(cls, words)
    platen = Platen(protocol(top_speed))
    peak = float(HiddenPad(constants).force(platen, platen.kinks).max())
    depth = float(platen.displacement(platen.kinks).max())
    return draw_effect(name, rng, peak, depth, top_speed, _SIZE, constants, protocol)


def _given(cls: type[Effect], words: str) -> Effect:
    kinds = {field.name: int if field.type == "int" else float for field in fields(cls)}
    wanted = f"write {cls.name}:{','.join(f'{key}=...' for key in kinds)}"
    values: dict[str, float] = {}
    for word in words.split(","):
        key, _, number = (part.strip() for part in word.partition("="))
        if key not in kinds or key in values:
            raise InputError(f"'{word.strip()}' is no parameter of {cls.name}", remedy=wanted)
        try:
            values[key] = kinds[key](number)
        except ValueError:
            raise InputError(f"'{number}' is not a number for {key}", remedy=wanted) from None
    if len(values) < len(kinds):
        missing = ", ".join(key for key in kinds if key not in values)
        raise InputError(f"{cls.name} lacks {missing}", remedy=wanted)
    return cls(**values)
