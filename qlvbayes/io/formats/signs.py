"""Which columns must be turned over so that pressing is positive in both."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from qlvbayes.io.formats.format import Floats

_PLAIN = 2.0  # the larger swing of the force over the other one, from which on its sign is plain
_TRAVEL = 0.2  # share of the whole travel that must lie between the start and the peak force
_MOVED = 0.01  # share of the whole travel, from which on the platen has left its start


@dataclass(frozen=True)
class Signs:
    """Factors of displacement and force, -1 where turned over; why they are in doubt, if so.

    ``swing`` is the larger excursion of the force from its start over the other one; ``travel``
    the displacement at the peak force, from the start, as a share of the whole travel.
    """

    way: int
    load: int
    swing: float
    travel: float
    doubt: str = ""


def find_signs(way: Floats, load: Floats) -> Signs:
    """Signs from the data alone: force leaves its start mostly to the pressed side.

    A specimen that is pressed as far as it is pulled is in doubt, and one whose largest force is
    not away from where it began.
    """
    start = force_at_start(way, load)
    up, down = float(load.max()) - start, start - float(load.min())
    sense = 1 if up >= down else -1
    swing = max(up, down) / max(min(up, down), 1e-3 * max(up, down))
    peak = int(np.argmax(sense * load))
    span = float(way.max() - way.min())
    travel = float(way[peak] - way[0]) / span if span else 0.0
    signs = (1 if travel >= 0.0 else -1), sense
    if swing < _PLAIN:
        doubt = f"the force swings to both sides ({up:.3g} up, {down:.3g} down)"
    elif abs(travel) < _TRAVEL:
        doubt = f"the peak force lies {abs(travel):.0%} of the travel from the start"
    else:
        doubt = ""
    return Signs(*signs, swing, abs(travel), doubt)


def force_at_start(way: Floats, load: Floats) -> float:
    """Median force until the platen has moved."""
    moved = int(np.argmax(np.abs(way - way[0]) > _MOVED * float(np.ptp(way))))
    return float(np.median(load[: max(moved, 1)]))
