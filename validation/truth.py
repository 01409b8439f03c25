"""Translate what is hidden in a simulated pad to the package's hypotheses and constants.

Listed effects have the simulator's own constants. Of what the package has only nearly (`exact` is
False) the constants are where a fit may begin.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from blind.laws import Law
from blind.study import BlindStudy
from numpy.typing import NDArray

from qlvbayes.inference.forward.hypothesis import Hypothesis, Parameters
from qlvbayes.motion.experiment import Experiment
from qlvbayes.simulate import HIDDEN, Effect

Array = NDArray[np.float64]
Constants = dict[str, float | Sequence[float]]

_ACCELERATION = 1000.0  # mm/s2, whose jump makes the amplitude of the simulator's ringing
_SHOWN = 0.02  # least 1 + alpha d of a rate that falls in a straight line, as in the simulator
_LIKE_A_LINE = 3.0  # 1 + d/depth and (1 - d/(3 depth))^-3 begin alike
_ROOT = 3.0  # a leak with the root of time is followed by one that levels off at a third of it


@dataclass(frozen=True)
class Truth:
    """A hypothesis that is true, or nearest to it: constants by the name of a field's first one."""

    hypothesis: Hypothesis
    constants: Constants
    exact: bool

    def theta(self, own: Parameters) -> Array:
        """(F,) free numbers of these constants, within the priors' bounds."""
        found = np.zeros(own.size)
        for name, leaf in own.by_name.items():
            value = np.asarray(self.constants[name], dtype=float)
            found[list(leaf.theta)] = np.asarray(leaf.prior.unconstrain(value)).ravel()
        return np.asarray(own.within(found))

    def with_gap(self, gap: float) -> Truth:
        """With the rig's own gap (mm), where contact is not in it already."""
        name = "contact_offset.gap"
        if {"contact_offset", "gradual_contact"} & self.hypothesis.effects:
            return self
        constants = self.constants | {name: gap}
        return replace(self, hypothesis=self.hypothesis.plus("contact_offset"), constants=constants)


@dataclass(frozen=True)
class Rig:
    """Scales of the tests: gap (mm) at first, depth (mm), peak (N), duration (s)."""

    gap: float
    depth: float
    peak: float
    duration: float

    @classmethod
    def of(cls, study: BlindStudy, experiment: Experiment) -> Rig:
        """Return the scales of a simulated study, made ready for a diagnosis."""
        scales = experiment.scales
        return cls(study.rig.gap, scales.depth, scales.force, scales.clock)


def is_modelled(names: Iterable[str]) -> bool:
    """Return whether every hidden effect has a counterpart in the package; outsiders have none."""
    return all(name in HIDDEN or name in _FORMS for name in names)


def truths(law: Law, effects: Sequence[Effect], rig: Rig) -> list[Truth]:
    """Return the hidden laws and listed effects or forms, without the rig's gap and with it.

    Outsiders are left out: nothing stands for them.
    """
    own = [found for effect in effects if (found := _own(effect, rig))]
    exact = all(one.exact for one in own)
    modes = [one for one in own if one.name == "extra_relaxation_mode"]
    others = [one for one in own if one not in modes]
    elastic, constants = _elastic(law)
    relaxation, relaxing, alike = _relaxation(law, modes[0].constants if modes else None)
    constants |= relaxing
    for one in others:
        constants |= {f"{one.name}.{key}": value for key, value in one.constants.items()}
    gap = rig.gap
    for name in {"contact_offset.gap", "gradual_contact.gap"} & set(constants):
        constants[name] = float(np.asarray(constants[name])) + gap
    names = frozenset(name.split(".")[0] for name in constants if "." in name)
    plain = Truth(Hypothesis(elastic, relaxation, names), constants, exact and alike)
    found = [plain, plain.with_gap(gap)]
    return found if found[0] != found[1] else found[:1]


@dataclass(frozen=True)
class _Own:
    """An effect of the package with its constants; exact: whether it is the hidden one's law."""

    name: str
    constants: dict[str, float]
    exact: bool = True


def _own(effect: Effect, rig: Rig) -> _Own | None:
    """The package's effect for a hidden one; None for an outsider."""
    if effect.name in HIDDEN:
        return _Own(effect.name, dict(effect.parameters))
    make = _FORMS.get(effect.name)
    return make(effect.parameters, rig) if make else None


def _levelling(p: dict[str, float]) -> dict[str, float]:
    return {"rate": p["share"] / p["time"], "back": (1.0 - p["share"]) / p["time"]}


def _root_leak(p: dict[str, float], rig: Rig) -> _Own:
    share = min(p["k"] * math.sqrt(rig.duration), 0.9)
    return _Own("levelling_leak", _levelling({"share": share, "time": rig.duration / _ROOT}), False)


def _linear_rate(p: dict[str, float], rig: Rig) -> _Own:
    alpha = math.log(max(1.0 + p["alpha"] * rig.depth, _SHOWN)) / rig.depth
    return _Own("strain_dependent_rate", {"alpha": alpha}, False)


def _drainage(p: dict[str, float], rig: Rig) -> _Own:
    """The package's stroke is the largest displacement."""
    tau = 1.0 / (p["k"] * p["drain"] * rig.depth)
    return _Own("power_law_drainage", {"k": p["k"], "tau": tau, "a": 0.0, "n": 2.0})


def _drift(p: dict[str, float], rig: Rig) -> _Own:
    return _Own("levelling_drift", {"rate": p["offset"] / p["time"], "slowing": 1.0 / p["time"]})


def _ringing(p: dict[str, float], rig: Rig) -> _Own:
    """Return ringing of acceleration jumps; speed jumps are most like it a quarter period later."""
    turn = 2.0 * math.pi * p["frequency"]
    strength = p["amplitude"] * turn / _ACCELERATION
    shape = {"frequency": p["frequency"], "damping": 1.0 / (turn * p["decay"])}
    return _Own("frame_ringing", {"strength": strength} | shape, False)


def _contact(gap: float, over: float) -> _Own:
    return _Own("gradual_contact", {"gap": gap, "over": over}, False)


def _film(eta: float, h: float) -> _Own:
    return _Own("squeeze_film", {"eta": eta, "h": h}, False)


def _mode(c: float, time: float) -> _Own:
    return _Own("extra_relaxation_mode", {"c": c, "v": 1.0 / time}, False)


_FORMS: dict[str, Callable[[dict[str, float], Rig], _Own]] = {
    "stretched_relaxation": lambda p, rig: _mode(p["c"], p["time"]),
    "poroelastic_diffusion": lambda p, rig: _mode(p["c"], p["time"]),
    "linear_rate": _linear_rate,
    "exponential_softening": lambda p, rig: _Own("stress_softening", {"s": p["s"]}, False),
    "healing_softening": lambda p, rig: _Own("stress_softening", {"s": p["s"]}, False),
    "saturating_leak": lambda p, rig: _Own("levelling_leak", _levelling(p)),
    "root_leak": _root_leak,
    "growing_drag": lambda p, rig: _film(p["eta"], _LIKE_A_LINE * p["depth"]),
    "steep_squeeze_film": lambda p, rig: _film(p["eta"], 2.0 * p["h"]),
    "cavitating_film": lambda p, rig: _film(p["eta"], p["h"]),
    "quadratic_pressure": _drainage,
    "coulomb_friction": lambda p, rig: _Own(
        "pressure_friction", {"strength": p["mu"] * rig.peak, "reach": p["reach"], "share": 1.0}
    ),
    "one_way_friction": lambda p, rig: _Own(
        "friction", {"strength": 0.5 * p["strength"], "reach": p["reach"]}, False
    ),
    "ringing": _ringing,
    "toe": lambda p, rig: _contact(0.5 * p["depth"], p["depth"]),
    "tilted_platen": lambda p, rig: _contact(0.5 * p["rise"], 0.5 * p["rise"]),
    "bending_frame": lambda p, rig: _Own(
        "stiffening_frame", {"compliance": p["compliance"], "stiff": p["force"]}
    ),
    "saturating_drift": _drift,
    "channel_low_pass": lambda p, rig: _Own("spreading_lag", {"delay": p["time"], "spread": 1.0}),
    "adhesion_at_a_stretch": lambda p, rig: _Own("adhesion_at_a_stretch", p),
    "guide_friction": lambda p, rig: _Own("guide_friction", p),
    "guide_drag": lambda p, rig: _Own("guide_drag", p),
}
"""The nearest effect of the package to every form of the simulator, by its constants."""


def _elastic(law: Law) -> tuple[str, Constants]:
    """Name and constants of the elastic law."""
    first, *rest = law.curve
    match law.elastic, rest:
        case "exponential", [b]:
            return "exponential", {"m": first, "b": b}
        case "hertz", []:
            return "hertz", {"m": first, "n": 1.5}
        case "polynomial", [second, third]:
            return "polynomial:3", {"m": first, "k2": first * second, "k3": first * third}
        case "toe", [b, depth]:
            return "toe", {"m": first, "b": b, "toe": depth}
    raise ValueError(f"no counterpart of the elastic law {law.elastic}")


def _relaxation(law: Law, extra: dict[str, float] | None) -> tuple[str, Constants, bool]:
    """Name and constants of the relaxation, with one mode more; whether that is all there is.

    A series of more than two modes is one of two with an extra mode.
    """
    if law.relaxation.startswith("prony"):
        return _series(law, extra)
    first, second, third = law.fading
    names = {
        "power-law": ("c0", "tau", "alpha"),
        "stretched": ("c0", "tau", "beta"),
        "fung": ("c", "tau1", "tau2"),
    }[law.relaxation]
    found: Constants = dict(zip(names, (first, second, third), strict=True))
    for key, value in (extra or {}).items():
        found[f"extra_relaxation_mode.{key}"] = value
    return law.relaxation, found, True


def _series(law: Law, extra: dict[str, float] | None) -> tuple[str, Constants, bool]:
    share = extra["c"] if extra else 0.0
    modes = [((1.0 - share) * c, v) for c, v in zip(law.c[1:], law.v, strict=True)]
    modes += [(extra["c"], extra["v"])] if extra else []
    modes.sort(key=lambda mode: -mode[1])
    exact = len(modes) <= 3
    while len(modes) > 3:  # the two nearest become one
        k = min(range(len(modes) - 1), key=lambda k: modes[k][1] / modes[k + 1][1])
        (a, v), (b, w) = modes[k : k + 2]
        modes[k : k + 2] = [(a + b, math.exp((a * math.log(v) + b * math.log(w)) / (a + b)))]
    found: Constants = {}
    rest = 1.0
    if len(modes) == 3:
        c, v = modes.pop(1)
        found = {"extra_relaxation_mode.c": c, "extra_relaxation_mode.v": v}
        rest = 1.0 - c
    shares = [c / rest for c, _ in modes]
    found |= {"c[0]": (1.0 - sum(shares), *shares), "v[1]": tuple(v for _, v in modes)}
    return "prony:2", found, exact
