"""Random parameters of a hidden effect, such that it has a chosen size."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import log

import numpy as np

from qlvbayes.io.checks import InputError

from ..constants import TABLE_1, Constants
from ..motion import Motion
from ..platen import PAPER_RATES, Move, Platen, Step
from .catalogue import effect_class
from .effect import Effect
from .mesh import Array
from .pad import HiddenPad
from .recipes import Draw, Protocol, Recipe

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
    """Draw an effect whose largest contribution to the force in a study is `size` of the peak.

    The contribution is measured in trial runs of six tests with the effect and without. Where
    an effect cannot be that large, such as a fast extra mode at slow rates, it is as large as it
    sensibly gets. Signs are random where both are physical.

    Parameters
    ----------
    kind : name of a listed effect, or the class of any
    rng : source of all randomness
    pad_peak_force : N, largest force of the pad in the study
    depth, top_speed : of the study, mm and mm/s
    size : share of the peak force
    constants : of the pad; without, a pad like the paper's B of the same peak force
    protocol : of the tests; without, the paper's, or two full retractions for the effects that
        show on the way back only (softening and adhesion)

    Raises
    ------
    InputError
        Unknown name, or a number that is not above 0.
    """
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
    """Draw an effect whose largest contribution to these tests of this pad is `size` of the peak.

    As `draw_effect`, but of any pad in any motions (with their clocks); `rates` (1/s) are those
    that an extra relaxation mode keeps away from.
    """
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
    """Value of the size parameter that gives the share `size`, or the cap if none does.

    Regula falsi in the logarithms, starting from proportionality.
    """
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
