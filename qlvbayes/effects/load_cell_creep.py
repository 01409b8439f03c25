"""Define the creep of the load cell under load."""

from __future__ import annotations

from typing import ClassVar, Self

import numpy as np

from qlvbayes import xp
from qlvbayes.effects.effect import AbstractEffect, Level
from qlvbayes.effects.history import fading
from qlvbayes.effects.spans import after_ramps
from qlvbayes.laws.elastic.linear import Linear
from qlvbayes.laws.hereditary import Relaxing, hereditary_force, hereditary_step
from qlvbayes.laws.layered import Law, State
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.relaxation.prony import Prony
from qlvbayes.laws.scales import Scales
from qlvbayes.priors import LogUniform
from qlvbayes.priors.distributions import Constant
from qlvbayes.xp import Array


class LoadCellCreep(AbstractEffect):
    """Creep of the load cell: F = F_below + share y, with dy/dt = (F_below - y)/time.

    The cell is at rest under the first force of a record, :math:`y(0) = F_{below}(0)`.

    * ``share``: share of a load that the cell adds in the end, zero or more.
    * ``time``: time constant of the creep (s).
    """

    share: Constant
    time: Constant
    name: ClassVar[str] = "load_cell_creep"
    level: ClassVar[Level] = Level.SENSOR
    rank: ClassVar[int] = 4
    units: ClassVar[dict[str, str]] = {"share": "fraction", "time": "time"}
    null: ClassVar[dict[str, float]] = {"share": 0.0}
    law: ClassVar[str] = "F += share y, dy/dt = (F - y)/time"
    seen: ClassVar[str] = "force creeps up under load, and stays for a while when it is gone"
    reference: ClassVar[str] = "ISO 376:2011, creep of a force transducer"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the effect with a share scaled by the peak force."""
        return cls(scales.positive(0.7 * scales.force), LogUniform(*after_ramps(scales)))

    def force(self, below: Law, motion: Motion) -> Array:
        """Return the force with the cell's creep added."""
        load = below.force(motion)
        lacking = hereditary_force(*self._mode, motion.time, load - load[0])
        return load + self.share * (load - lacking)

    def begin(self, below: Law, displacement: Array) -> State:
        """Return the state of the law beneath, and the load under which the cell is at rest."""
        inner = below.begin(displacement)
        still = xp.zeros_like(displacement)
        load = below.step(inner, Line(still, displacement, still))[1]
        return inner, Relaxing(load, np.zeros(1))

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        """Return the state and the force with the cell's creep added."""
        inner, own = state
        inner, load = below.step(inner, line)
        own, lacking = hereditary_step(*self._mode, own, line.duration, load)
        return (inner, own), load + self.share * (load - lacking)

    @property
    def _mode(self) -> tuple[Linear, Prony]:
        """Return the laws whose hereditary integral of F is F - y: linear, with one mode."""
        return fading(1.0, 1.0 / self.time)
