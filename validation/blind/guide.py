"""Effects of the platen's guide, between pad and load cell: they act off the pad too."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar

import numpy as np

from qlvbayes.simulate.hidden.effect import Effect, Recipe, depth_of, peak_of
from qlvbayes.simulate.hidden.mesh import Array, Path
from qlvbayes.simulate.motion import Motion
from qlvbayes.simulate.platen import pull_off_protocol

_LATE = 55  # order: outside the frame, inside the sensor


@dataclass(frozen=True)
class GuideFriction(Effect):
    """F -> F + strength ((1 - sharp) z + sharp s), with z and s along the platen's way; N, mm.

    z is Dahl's; s is a spring of unit force at `reach` that slides at 1. Both are solved from
    one turn of the platen to the next, in between in closed form.
    """

    name: ClassVar[str] = "guide_friction"
    recipe: ClassVar[Recipe] = Recipe(
        "strength",
        per=peak_of,
        shape=lambda x: {"reach": depth_of(x) * x.spread(0.003, 0.03), "sharp": x.even(0.5, 1.0)},
        protocols=(pull_off_protocol,),
    )
    order: ClassVar[int] = _LATE
    family: ClassVar[str] = "friction"
    positive: ClassVar[tuple[str, ...]] = ("reach",)
    shares: ClassVar[tuple[str, ...]] = ("sharp",)

    strength: float
    reach: float
    sharp: float

    def on_force(self, force: Array, path: Path) -> Array:
        """Add the friction."""
        turns = _turns(path.platen)
        places = path.platen.displacement(turns)
        begun = [(np.zeros(()), np.zeros(()))]
        for here, there in pairwise(places):
            begun.append(self._after(*begun[-1], there - here))
        last = np.clip(np.searchsorted(turns, path.time, side="right") - 1, 0, turns.size - 1)
        gradual, sprung = np.array(begun)[last].transpose(2, 0, 1)
        travel = path.platen.displacement(path.time) - places[last]
        z, s = self._after(gradual, sprung, travel)
        return force + self.strength * ((1.0 - self.sharp) * z + self.sharp * s)

    def _after(self, gradual: Array, sprung: Array, travel: Array) -> tuple[Array, Array]:
        """Dahl's z and the spring after a way in one direction."""
        way, sign = np.abs(travel) / self.reach, np.sign(travel)
        gone = np.exp(-way)
        z = gradual * gone + sign * (1.0 - gone)
        return z, np.where(way > 0.0, sign * np.minimum(sign * sprung + way, 1.0), sprung)


@dataclass(frozen=True)
class GuideDrag(Effect):
    """F -> F + eta V, V the platen's velocity; eta in N s/mm."""

    name: ClassVar[str] = "guide_drag"
    recipe: ClassVar[Recipe] = Recipe("eta", 0.003, per=peak_of, protocols=(pull_off_protocol,))
    order: ClassVar[int] = _LATE + 1
    family: ClassVar[str] = "viscous_drag"

    eta: float

    def on_force(self, force: Array, path: Path) -> Array:
        """Add the drag."""
        return force + self.eta * path.platen.velocity(path.time)


def _turns(platen: Motion) -> Array:
    """Return the times between which the platen goes one way only, from 0 to the end."""
    times = [platen.duration]
    for piece in platen.pieces:
        times.append(piece.start)
        if piece.acceleration != 0.0:
            stop = -piece.velocity / piece.acceleration
            if 0.0 < stop < piece.duration:
                times.append(piece.start + stop)
    return np.unique(times)
