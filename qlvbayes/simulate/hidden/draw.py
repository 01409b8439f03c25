"""Random parameters of a hidden effect, such that it has a chosen size."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from math import exp, log
from typing import Any

import numpy as np

from qlvbayes.io.checks import InputError

from ..constants import TABLE_1, Constants
from ..motion import Motion
from ..platen import PAPER_RATES, Move, Platen, Step, full_retraction_protocol, paper_protocol
from .catalogue import effect_class
from .effect import Effect
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

Protocol = Callable[[float], tuple[Step, ...]]


@dataclass(frozen=True)
class Draw:
    """What the parameters are drawn from.

    Parameters
    ----------
    rng : source of all randomness
    peak : N, largest force of the pad in the study
    depth : mm, largest depth
    rates : 1/s, of the pad's own relaxation
    study_s : length of the study, s
    """

    rng: np.random.Generator
    peak: float
    depth: float
    rates: tuple[float, ...]
    study_s: float

    def even(self, low: float, high: float) -> float:
        """Uniform between two bounds."""
        return float(self.rng.uniform(low, high))

    def spread(self, low: float, high: float) -> float:
        """Log-uniform between two bounds."""
        return exp(self.rng.uniform(log(low), log(high)))

    def rate(self) -> float:
        """Rate of relaxation in 0.03 to 60 1/s, a factor 3 or more from the pad's own."""
        for _ in range(1000):
            rate = self.spread(0.03, 60.0)
            if all(abs(log(rate / own)) >= log(3.0) for own in self.rates):
                return rate
        raise InputError(f"no rate is far from {self.rates} 1/s")

    def seed(self) -> int:
        """Seed of an effect that is itself random."""
        return int(self.rng.integers(2**31))


@dataclass(frozen=True)
class _Recipe:
    """How an effect is drawn: its shape, and the parameter that sets its size.

    `guess` in the units of `per`: 'peak' (N), 'depth' (mm) or 1; `cap` likewise.
    """

    size: str
    guess: float = 0.05
    cap: float = np.inf
    per: Callable[[Draw], float] = lambda draw: 1.0
    shape: Callable[[Draw], dict[str, Any]] = lambda draw: {}
    protocols: tuple[Protocol, ...] = field(default=(paper_protocol,))


def _peak(draw: Draw) -> float:
    return draw.peak


def _depth(draw: Draw) -> float:
    return draw.depth


def _per_depth(draw: Draw) -> float:
    return 1.0 / draw.depth


def _stiffness(draw: Draw) -> float:
    return draw.peak / draw.depth


def _film(draw: Draw) -> dict[str, Any]:
    return {"h": draw.depth * draw.even(1.3, 3.0)}


def _softening(draw: Draw) -> dict[str, Any]:
    return {"k": draw.even(1.0, 5.0)}


def _reach(draw: Draw) -> dict[str, Any]:
    return {"reach": draw.depth * draw.spread(0.01, 0.06)}


def _pressure(draw: Draw) -> dict[str, Any]:
    return {"tau": draw.spread(0.1, 10.0), "a": draw.even(0.0, 1.0) / draw.depth}


def _swing(draw: Draw) -> dict[str, Any]:
    return {"period": draw.spread(40.0, 400.0), "phase": draw.even(-np.pi, np.pi)}


def _creep(draw: Draw) -> dict[str, Any]:
    return {"begin": draw.even(0.2, 0.7) * draw.study_s, "time": draw.spread(5.0, 100.0)}


_RETURN = (full_retraction_protocol,)
_RECIPES = {
    "extra_relaxation_mode": _Recipe("c", 0.1, 0.6, shape=lambda x: {"v": x.rate()}),
    "strain_dependent_rate": _Recipe("alpha", 0.3, 5.0, _per_depth),
    "strain_dependent_strength": _Recipe("beta", 0.1, 2.0, _per_depth),
    "stress_softening": _Recipe("s", 0.3, 0.9, protocols=_RETURN),
    "fluid_leak": _Recipe("rate", 0.05, 10.0, lambda x: 1.0 / x.study_s),
    "viscous_drag": _Recipe("eta", 0.002, per=_peak),
    "power_law_drag": _Recipe("k", 0.01, per=_peak, shape=lambda x: {"n": x.even(0.3, 0.8)}),
    "squeeze_film": _Recipe("eta", 0.001, per=_peak, shape=_film),
    "fluid_pressure": _Recipe("k", 0.05, per=_stiffness, shape=_pressure),
    "friction": _Recipe("strength", per=_peak, shape=_reach),
    "permanent_set": _Recipe("share", 0.05, 0.5),
    "contact_offset": _Recipe("gap", 0.03, 0.5, _depth),
    "adhesion": _Recipe("strength", per=_peak, cap=1.0, protocols=_RETURN),
    "frame_compliance": _Recipe("compliance", 0.03, 1.0, lambda x: x.depth / x.peak),
    "inertia": _Recipe("mass", 5e-5, per=_peak),
    "force_offset": _Recipe("offset", per=_peak),
    "force_drift": _Recipe("rate", per=lambda x: x.peak / x.study_s),
    "channel_lag": _Recipe("delay", 1e-3, 0.05),
    "stretched_relaxation": _Recipe(
        "c", 0.1, 0.6, shape=lambda x: {"time": 1.0 / x.rate(), "exponent": x.even(0.3, 0.7)}
    ),
    "linear_rate": _Recipe("alpha", 0.3, 20.0, _per_depth),
    "exponential_softening": _Recipe("s", 0.3, 0.9, shape=_softening, protocols=_RETURN),
    "saturating_leak": _Recipe(
        "share", 0.08, 0.9, shape=lambda x: {"time": x.study_s * x.even(0.05, 0.4)}
    ),
    "growing_drag": _Recipe(
        "eta", 0.002, per=_peak, shape=lambda x: {"depth": x.depth * x.even(0.2, 1.0)}
    ),
    "steep_squeeze_film": _Recipe("eta", 0.001, per=_peak, shape=_film),
    "quadratic_pressure": _Recipe(
        "k", 0.05, 5.0, _stiffness, lambda x: {"drain": x.spread(10.0, 300.0) / x.peak}
    ),
    "coulomb_friction": _Recipe("mu", 0.05, 0.9, shape=_reach),
    "toe": _Recipe("depth", 0.1, 1.0, _depth),
    "bending_frame": _Recipe(
        "compliance",
        0.05,
        1.0,
        lambda x: x.depth / x.peak,
        lambda x: {"force": x.peak * x.even(0.3, 1.5)},
    ),
    "saturating_drift": _Recipe(
        "offset", per=_peak, shape=lambda x: {"time": x.study_s * x.even(0.05, 0.4)}
    ),
    "channel_low_pass": _Recipe("time", 1e-3, 0.1),
    "second_contact": _Recipe(
        "stiffness", 0.2, per=_stiffness, shape=lambda x: {"depth": x.depth * x.even(0.4, 0.8)}
    ),
    "slip": _Recipe("share", 0.2, 0.9, shape=lambda x: {"seed": x.seed()}),
    "temperature_swing": _Recipe("share", 0.05, 0.9, shape=_swing),
    "conditioning": _Recipe("share", 0.08, 0.9, shape=lambda x: {"tests": x.even(0.5, 3.0)}),
    "ringing": _Recipe(
        "amplitude",
        per=_peak,
        shape=lambda x: {"frequency": x.spread(5.0, 20.0), "decay": x.spread(0.1, 0.5)},
    ),
    "rezeroed": _Recipe("sd", per=_peak, shape=lambda x: {"seed": x.seed()}),
    "slow_creep_jump": _Recipe("offset", per=_peak, shape=_creep),
    "sensor_nonlinearity": _Recipe(
        "amplitude", per=_peak, shape=lambda x: {"period": x.peak / x.even(1.2, 1.8)}
    ),
    "amplifier_clipping": _Recipe("level", per=_peak),
    "cavitating_film": _Recipe(
        "eta", 0.001, per=_peak, shape=lambda x: _film(x) | {"limit": x.peak * x.even(0.005, 0.03)}
    ),
    "poroelastic_diffusion": _Recipe("c", 0.1, 0.6, shape=lambda x: {"time": x.spread(0.3, 30.0)}),
    "tilted_platen": _Recipe("rise", 0.1, 1.0, _depth),
    "root_leak": _Recipe("k", 0.05, 5.0, lambda x: x.study_s**-0.5),
    "one_way_friction": _Recipe("strength", per=_peak, shape=_reach),
    "healing_softening": _Recipe("s", 0.3, 0.9, shape=lambda x: {"time": x.spread(0.3, 10.0)}),
    "viscous_heating": _Recipe(
        "share",
        0.1,
        0.9,
        shape=lambda x: {"power": x.peak * x.spread(0.5, 5.0), "time": x.spread(0.5, 20.0)},
    ),
    "backlash": _Recipe("play", 0.02, 0.5, _depth),
    "drive_ripple": _Recipe(
        "amplitude", per=_peak, shape=lambda x: {"pitch": x.depth * x.even(0.1, 0.4)}
    ),
    "load_cell_creep": _Recipe("share", 0.05, 0.9, shape=lambda x: {"time": x.spread(2.0, 60.0)}),
    "stick_slip": _Recipe(
        "amplitude", per=_peak, shape=lambda x: {"pitch": x.depth * x.even(0.08, 0.3)}
    ),
    "snap_through": _Recipe(
        "drop", per=_peak, shape=lambda x: {"depth": x.depth * x.even(0.4, 0.8)}
    ),
    "thixotropy": _Recipe(
        "share",
        0.1,
        0.9,
        shape=lambda x: {"time": x.spread(2.0, 60.0), "way": x.depth * x.even(0.2, 1.0)},
    ),
    "curing": _Recipe(
        "share",
        0.1,
        shape=lambda x: {
            "middle": x.study_s * x.even(0.3, 0.7),
            "width": x.study_s * x.even(0.03, 0.1),
        },
    ),
}


def draw_effect(
    name: str,
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
    name : of any hidden effect, form or outsider
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
    effect_class(name)  # refuses one that is not known
    if not min(pad_peak_force, depth, top_speed, size) > 0 or not size < 1:
        raise InputError("peak force, depth, speed and size must be above 0, and size below 1")
    recipe = _RECIPES[name]
    trial = _trial(constants, protocol or recipe.protocols[0], pad_peak_force, depth, top_speed)
    draw = Draw(rng, trial.peak, depth, trial.pad.constants.v, trial.study_s)
    return _drawn(name, draw, trial, size)


def draw_effect_in(
    name: str,
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
    trial = _Trial(pad, tuple(motions), times, forces, peak)
    return _drawn(name, Draw(rng, peak, depth, tuple(rates), trial.study_s), trial, size)


def _drawn(name: str, draw: Draw, trial: _Trial, size: float) -> Effect:
    cls, recipe, rng = effect_class(name), _RECIPES[name], draw.rng
    if name == "amplifier_clipping":
        return cls(**{recipe.size: trial.peak * (1.0 - size)})
    shape = recipe.shape(draw)
    sign = rng.choice([-1.0, 1.0]) if recipe.size in cls.signed else 1.0
    unit = recipe.per(draw)

    def build(value: float) -> Effect:
        return cls(**{recipe.size: float(sign * unit * value), **shape})

    return build(_sized(build, recipe, trial, size))


@dataclass(frozen=True)
class _Trial:
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
) -> _Trial:
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
    return _Trial(pad, tuple(platens), times, tuple(forces), top)


def _scaled(step: Step, stretch: float) -> Step:
    return replace(step, target=step.target * stretch) if isinstance(step, Move) else step


def _moments(platen: Motion) -> Array:
    """Moments at which something may show: even in each piece, and soon after it began."""
    if len(platen.pieces) > _MANY_PIECES:
        return np.linspace(0.0, platen.duration, _EVEN_MOMENTS)
    shares = np.concatenate([[0.0], np.geomspace(1e-4, 0.03, 8), np.linspace(0.04, 0.999, 25)])
    times = [piece.start + shares * piece.duration for piece in platen.pieces]
    soon = np.concatenate([kink + _SOON_S for kink in platen.kinks])
    times.append(soon[soon < platen.duration])
    return np.unique(np.concatenate([*times, [platen.duration]]))


def _sized(build: Callable[[float], Effect], recipe: _Recipe, trial: _Trial, size: float) -> float:
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
