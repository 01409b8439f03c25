"""Effects in the load cell and its channel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from .effect import Effect
from .mesh import Array, Path
from .recipes import Recipe, peak_of


@dataclass(frozen=True)
class Inertia(Effect):
    """F -> F + mass a, a the platen's acceleration; mass in N s2/mm."""

    name: ClassVar[str] = "inertia"
    recipe: ClassVar[Recipe] = Recipe("mass", 5e-5, per=peak_of)
    order: ClassVar[int] = 60

    mass: float

    def on_force(self, force: Array, path: Path) -> Array:
        """Add the force on the moved mass."""
        return force + self.mass * path.acceleration


@dataclass(frozen=True)
class ForceOffset(Effect):
    """F -> F + offset; N, either sign."""

    name: ClassVar[str] = "force_offset"
    recipe: ClassVar[Recipe] = Recipe("offset", per=peak_of)
    order: ClassVar[int] = 61
    signed: ClassVar[tuple[str, ...]] = ("offset",)

    offset: float

    def on_force(self, force: Array, path: Path) -> Array:
        """Shift the force."""
        return force + self.offset


@dataclass(frozen=True)
class ForceDrift(Effect):
    """F -> F + rate t, t the clock since the pad's first test began; N/s, either sign."""

    name: ClassVar[str] = "force_drift"
    recipe: ClassVar[Recipe] = Recipe("rate", per=lambda x: x.peak / x.study_s)
    order: ClassVar[int] = 62
    signed: ClassVar[tuple[str, ...]] = ("rate",)

    rate: float

    def on_force(self, force: Array, path: Path) -> Array:
        """Shift the force with the clock."""
        return force + self.rate * path.clock


@dataclass(frozen=True)
class LoadCellCreep(Effect):
    """F -> F + share y, y' = (F - y)/time: the load cell's own after-effect; s."""

    name: ClassVar[str] = "load_cell_creep"
    recipe: ClassVar[Recipe] = Recipe(
        "share", 0.05, 0.9, shape=lambda x: {"time": x.spread(2.0, 60.0)}
    )
    order: ClassVar[int] = 67
    positive: ClassVar[tuple[str, ...]] = ("time",)

    share: float
    time: float

    def on_force(self, force: Array, path: Path) -> Array:
        """Creep towards the load."""
        return force + self.share * path.follow(1.0 / self.time, force)


@dataclass(frozen=True)
class ChannelLag(Effect):
    """F(t) -> F(t - delay); before the start the force of the start; delay in s."""

    name: ClassVar[str] = "channel_lag"
    recipe: ClassVar[Recipe] = Recipe("delay", 1e-3, 0.05)
    order: ClassVar[int] = 69

    delay: float

    def late(self) -> float:
        """Seconds by which the force comes late."""
        return self.delay
