"""More effects outside of every list: no law, form or free curve of the package stands for them."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import ClassVar

import numpy as np

from blind.outside import stream
from qlvbayes.simulate.hidden.effect import Effect, Recipe, peak_of
from qlvbayes.simulate.hidden.mesh import Array, Path


@dataclass(frozen=True)
class ViscousHeating(Effect):
    """F -> F (1 - share T), T' = (|F v| / power - T) / time: the pad warms by what it dissipates.

    power in N mm/s, time in s; T is 1 where the power acts for long.
    """

    name: ClassVar[str] = "viscous_heating"
    recipe: ClassVar[Recipe] = Recipe(
        "share",
        0.1,
        0.9,
        shape=lambda x: {"power": x.peak * x.spread(0.5, 5.0), "time": x.spread(0.5, 20.0)},
    )
    order: ClassVar[int] = 22
    positive: ClassVar[tuple[str, ...]] = ("power", "time")

    share: float
    power: float
    time: float

    def on_force(self, force: Array, path: Path) -> Array:
        """Soften by the warmth."""
        heat = np.abs(force * path.velocity) / self.power
        warm = path.follow(1.0 / self.time, heat, start=0.0)
        return force * np.maximum(1.0 - self.share * warm, 0.05)


@dataclass(frozen=True)
class DriveRipple(Effect):
    """F -> F + amplitude sin(2 pi d / pitch) while the platen moves: the motor's current; N, mm."""

    name: ClassVar[str] = "drive_ripple"
    recipe: ClassVar[Recipe] = Recipe(
        "amplitude", per=peak_of, shape=lambda x: {"pitch": x.depth * x.even(0.1, 0.4)}
    )
    order: ClassVar[int] = 63
    positive: ClassVar[tuple[str, ...]] = ("pitch",)

    amplitude: float
    pitch: float

    def on_force(self, force: Array, path: Path) -> Array:
        """Add the ripple; at rest the current is gone. Below 1e-3 mm/s the drive counts as idle."""
        position = path.platen.displacement(path.time)
        speed = np.abs(path.platen.velocity(path.time))
        driven = speed / (speed + 1e-3)
        return force + self.amplitude * driven * np.sin(2.0 * pi * position / self.pitch)


@dataclass(frozen=True)
class StickSlip(Effect):
    """F -> F + amplitude saw(s / pitch) sgn(way), s the way travelled; N, mm.

    saw rises from 0 to 1 over nine tenths of a pitch and falls in the rest; at rest it stays.
    """

    name: ClassVar[str] = "stick_slip"
    recipe: ClassVar[Recipe] = Recipe(
        "amplitude", per=peak_of, shape=lambda x: {"pitch": x.depth * x.even(0.08, 0.3)}
    )
    order: ClassVar[int] = 37
    positive: ClassVar[tuple[str, ...]] = ("pitch",)

    amplitude: float
    pitch: float

    def on_force(self, force: Array, path: Path) -> Array:
        """Add the sawtooth."""
        travel = np.diff(path.depth.ravel(), prepend=path.depth.flat[0])
        phase = np.mod(np.cumsum(np.abs(travel)) / self.pitch, 1.0)
        saw = np.minimum(phase / 0.9, (1.0 - phase) / 0.1)
        direction = _last_way(travel)
        return force + self.amplitude * (saw * direction).reshape(force.shape)


@dataclass(frozen=True)
class SnapThrough(Effect):
    """F -> F - drop x, x in {0, 1}: a wall that buckles at `depth` going in, back at 0.8 depth.

    The state changes within 2 % of the depth, so that the force falls steeply, not at once; mm, N.
    """

    name: ClassVar[str] = "snap_through"
    recipe: ClassVar[Recipe] = Recipe(
        "drop", per=peak_of, shape=lambda x: {"depth": x.depth * x.even(0.4, 0.8)}
    )
    order: ClassVar[int] = 38
    positive: ClassVar[tuple[str, ...]] = ("depth",)

    drop: float
    depth: float

    def on_force(self, force: Array, path: Path) -> Array:
        """Take away the wall's share."""
        width = 0.02 * self.depth
        rise = np.clip((path.depth - self.depth) / width, 0.0, 1.0).ravel()
        stay = np.clip((path.depth - 0.8 * self.depth) / width, 0.0, 1.0).ravel()
        state, states = 0.0, []
        for low, high in zip(rise.tolist(), stay.tolist(), strict=True):
            state = min(max(state, low), high)
            states.append(state)
        return force - self.drop * np.array(states).reshape(force.shape)


@dataclass(frozen=True)
class Curing(Effect):
    """F -> F (1 + share / (1 + e^{-(t - middle)/width})), t the clock: the material sets; s."""

    name: ClassVar[str] = "curing"
    recipe: ClassVar[Recipe] = Recipe(
        "share",
        0.1,
        shape=lambda x: {
            "middle": x.study_s * x.even(0.3, 0.7),
            "width": x.study_s * x.even(0.03, 0.1),
        },
    )
    order: ClassVar[int] = 24
    positive: ClassVar[tuple[str, ...]] = ("width",)

    share: float
    middle: float
    width: float

    def on_force(self, force: Array, path: Path) -> Array:
        """Stiffen with the clock."""
        return force * (1.0 + self.share / (1.0 + np.exp(-(path.clock - self.middle) / self.width)))


@dataclass(frozen=True)
class Bubble(Effect):
    """F -> F + strength (n q - 1), n' = n (1 - n q)/time, q = (1 - d/height)^-1.4: a bubble; N.

    n is the gas that is left and n q its pressure, both over those at first; height in mm, time in
    s. The gas keeps a tenth of its height.
    """

    name: ClassVar[str] = "bubble"
    recipe: ClassVar[Recipe] = Recipe(
        "strength",
        0.02,
        per=peak_of,
        shape=lambda x: {"height": x.depth * x.even(1.2, 2.0), "time": x.spread(5.0, 100.0)},
    )
    order: ClassVar[int] = 39
    positive: ClassVar[tuple[str, ...]] = ("height", "time")

    strength: float
    height: float
    time: float

    def on_force(self, force: Array, path: Path) -> Array:
        """Add the gas's pressure; in 1/n its equation is linear: (1/n)' = (q - 1/n)/time."""
        squeezed = np.maximum(1.0 - path.depth / self.height, 0.1) ** -1.4
        inverse = path.follow(1.0 / self.time, squeezed, start=1.0)
        return force + self.strength * (squeezed / inverse - 1.0)


@dataclass(frozen=True)
class MainsHum(Effect):
    """F -> F + amplitude sin(2 pi frequency t + phase), t the clock: a hum of 50 Hz; N, Hz."""

    name: ClassVar[str] = "mains_hum"
    recipe: ClassVar[Recipe] = Recipe(
        "amplitude",
        per=peak_of,
        shape=lambda x: {"frequency": x.even(49.95, 50.05), "phase": x.even(-pi, pi)},
    )
    order: ClassVar[int] = 64
    positive: ClassVar[tuple[str, ...]] = ("frequency",)
    signed: ClassVar[tuple[str, ...]] = ("phase",)

    amplitude: float
    frequency: float
    phase: float

    def on_force(self, force: Array, path: Path) -> Array:
        """Add the hum; a logger that reads less often than it folds it to another frequency."""
        return force + self.amplitude * np.sin(2.0 * pi * self.frequency * path.clock + self.phase)


@dataclass(frozen=True)
class CrackingSkin(Effect):
    """F -> F (1 - share)^n, n a Poisson process of rate (d/depth)^4 / time: a skin cracks; mm, s.

    Its jumps follow from `seed` and the clock at the start of the test, where the skin is whole.
    """

    name: ClassVar[str] = "cracking_skin"
    recipe: ClassVar[Recipe] = Recipe(
        "share",
        0.02,
        0.5,
        shape=lambda x: {"depth": x.depth, "time": x.even(3.0, 10.0), "seed": x.seed()},
    )
    order: ClassVar[int] = 26
    positive: ClassVar[tuple[str, ...]] = ("depth", "time")
    shares: ClassVar[tuple[str, ...]] = ("share",)

    share: float
    depth: float
    time: float
    seed: int

    def on_force(self, force: Array, path: Path) -> Array:
        """Lose a share with each crack."""
        rate = (np.maximum(path.depth, 0.0) / self.depth) ** 4 / self.time
        time = path.time.ravel()
        means = 0.5 * (rate.ravel()[1:] + rate.ravel()[:-1]) * np.diff(time)
        expected = np.append(0.0, np.cumsum(means))
        waits = stream(self.seed, path.platen).exponential(size=int(4.0 * expected[-1]) + 20)
        cracks = np.searchsorted(np.cumsum(waits), expected).reshape(force.shape)
        return force * (1.0 - self.share) ** cracks


@dataclass(frozen=True)
class RollingSpecimen(Effect):
    """F -> F (1 + share u), u even in -1..1 for each loading: the specimen rolls to another face.

    A loading begins where the depth has been below a tenth of `depth` (mm) and rises above a fifth,
    and between the two u passes from the last one to the next. The faces follow from `seed` and
    the clock at the start of the test.
    """

    name: ClassVar[str] = "rolling_specimen"
    recipe: ClassVar[Recipe] = Recipe(
        "share", 0.05, 0.9, shape=lambda x: {"depth": x.depth, "seed": x.seed()}
    )
    order: ClassVar[int] = 27
    positive: ClassVar[tuple[str, ...]] = ("depth",)
    shares: ClassVar[tuple[str, ...]] = ("share",)

    share: float
    depth: float
    seed: int

    def on_force(self, force: Array, path: Path) -> Array:
        """Scale each loading."""
        rng = stream(self.seed, path.platen)
        before = after = 0.0
        lifted, faces = True, []
        for depth in (path.depth.ravel() / self.depth).tolist():
            if depth < 0.1 and not lifted:
                before, lifted = after, True
            elif depth >= 0.1 and lifted:
                after, lifted = float(rng.uniform(-1.0, 1.0)), False
            turned = min(max(10.0 * depth - 1.0, 0.0), 1.0)
            faces.append(after if lifted else before + turned * (after - before))
            if not lifted and turned == 1.0:
                before = after
        return force * (1.0 + self.share * np.array(faces).reshape(force.shape))


@dataclass(frozen=True)
class Swelling(Effect):
    """F -> F (1 + share y), y' = (1 - y)/soak off load, -y/squeeze under load: it takes up fluid.

    Off load is less than a twentieth of `depth` (mm); y = 0 at first; times in s.
    """

    name: ClassVar[str] = "swelling"
    recipe: ClassVar[Recipe] = Recipe(
        "share",
        0.3,
        5.0,
        shape=lambda x: {
            "soak": x.study_s * x.even(0.3, 1.0),
            "squeeze": x.spread(3.0, 30.0),
            "depth": x.depth,
        },
    )
    order: ClassVar[int] = 28
    positive: ClassVar[tuple[str, ...]] = ("soak", "squeeze", "depth")

    share: float
    soak: float
    squeeze: float
    depth: float

    def on_force(self, force: Array, path: Path) -> Array:
        """Stiffen by the fluid taken up, before the test by the clock."""
        free = path.depth < 0.05 * self.depth
        taken = -np.expm1(-path.platen.start_s / self.soak)
        rate = np.where(free, 1.0 / self.soak, 1.0 / self.squeeze)
        return force * (1.0 + self.share * path.follow(rate, free.astype(float), start=taken))


@dataclass(frozen=True)
class DriveWarmth(Effect):
    """F -> F + offset T, T' = (|v| / speed - T) / time: the motor warms the cell; N, mm/s, s."""

    name: ClassVar[str] = "drive_warmth"
    recipe: ClassVar[Recipe] = Recipe(
        "offset", per=peak_of, shape=lambda x: {"speed": x.depth, "time": x.spread(3.0, 60.0)}
    )
    order: ClassVar[int] = 63
    positive: ClassVar[tuple[str, ...]] = ("speed", "time")
    signed: ClassVar[tuple[str, ...]] = ("offset",)

    offset: float
    speed: float
    time: float

    def on_force(self, force: Array, path: Path) -> Array:
        """Shift the zero by the warmth."""
        speed = np.abs(path.platen.velocity(path.time))
        return force + self.offset * path.follow(1.0 / self.time, speed / self.speed, start=0.0)


def _last_way(travel: Array) -> Array:
    """Sign of the last step that was one."""
    moved = np.where(travel != 0.0, np.arange(travel.size), 0)
    return np.sign(travel[np.maximum.accumulate(moved)])
