"""A pad simulated afresh, with something hidden in it, or nothing."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from qlvbayes.effects.catalogue import EFFECTS
from qlvbayes.simulate import (
    HIDDEN,
    NOISES,
    PAPER_RATES,
    PROTOCOLS,
    draw_constants,
    parse_effect,
    simulate_file,
)

NOTHING = 0.1  # share of pads in which nothing is hidden
_ROWS = 500  # a test
_NEED_RETRACTION = {"adhesion", "permanent_set", "stress_softening"}
"""What only a platen that goes all the way back shows."""


def deal(data: Path, truth: Path, seed: int) -> None:
    """Write measurements, and apart from them what is hidden; the same for the same seed.

    The effect is one of those listed, of 6 % of the peak force, as of ``qlvbayes simulate --hide``.
    """
    rng = np.random.default_rng(seed)
    constants = draw_constants(rng)
    names = [kind.name for kind in EFFECTS if kind.name in HIDDEN]
    chosen = names[int(rng.integers(len(names)))]
    # at times without need, or the motion would tell
    retracted = rng.random() < 0.5 or chosen in _NEED_RETRACTION
    protocol = "retraction" if retracted else "paper"
    effects = []
    if rng.random() >= NOTHING:
        effects = [parse_effect(chosen, constants, PROTOCOLS[protocol], max(PAPER_RATES), rng)]
    data.parent.mkdir(parents=True, exist_ok=True)
    simulate_file(
        data, {"pad": constants}, PAPER_RATES, NOISES["correlated"], seed, _ROWS, "",
        effects, protocol, truth,
    )  # fmt: skip
