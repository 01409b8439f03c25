"""``qlvbayes simulate``: data from the rig simulator."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from qlvbayes.cli.console import command_line, out, waiting
from qlvbayes.cli.options import split_names
from qlvbayes.io.checks import InputError, check_known
from qlvbayes.simulate import (
    NOISES,
    PROTOCOLS,
    SPECIMENS,  # noqa: F401  (in the help)
    parse_effect,
    simulate_file,
    specimens_of,
)

_DRAWN, _SPECIMENS = 1, 2  # random streams for effects and specimens, apart from the noise's


def simulate(
    output: Path,
    pads: str = "A,B,C",
    rates: str = "0.1,1,10,20,30,100",
    loads: str = "",
    noise: str = "correlated",
    max_rows: int | None = None,
    seed: int = 0,
    protocol: str = "paper",
    hide: list[str] | None = None,
    answer: Path | None = None,
) -> None:
    """Simulate the paper's tests: forward 1.6 mm, hold 30 s, back to 0.8 mm, hold 30 s.

    With --protocol retraction, twice forward 1.6 mm, hold 10 s, back to 0, hold 5 s; with pull_off
    back to 0.4 mm above the surface at 1 mm/s. With --loads, weights put on in 0.1 s, left 30 s,
    taken down to 30 %, left 30 s.

    The platen accelerates at most 1000 mm/s2, the encoder steps by 1 um, the load cell's noise is
    correlated, the record is taken at 1 kHz.

    Options:
    output -o --output: A .csv or .csv.gz file.
    pads: Of {SPECIMENS}; finger:4 is four of a kind, which differ, in a group.
    rates: Loading rates in mm/s, or none.
    loads: Loads in N: each adds a creep test, whose force is prescribed.
    noise --load-cell --noise: Noise of the load cell, one of {NOISES}.
    max_rows: Rows a test at most, thinned as a logger does.
    protocol: One of {PROTOCOLS}.
    hide: A physical effect to hide, such as viscous_drag:eta=0.003; a name alone is drawn at 6 % of
        the first pad's peak force. May be given again.
    answer: A .json file for what is hidden; the data then do not say it.
    """
    for folder in {path.parent for path in (output, answer) if path is not None}:
        if not folder.is_dir():  # refused before the work, not after it
            raise InputError("no such folder", file=folder, remedy="make it, or choose another")
    check_known("noise", noise, NOISES)
    check_known("protocol", protocol, PROTOCOLS)
    constants, groups = specimens_of(split_names(pads), np.random.default_rng([seed, _SPECIMENS]))
    weights = _above_zero(loads, "loads", "0.5,1") if loads else ()
    speeds = () if rates == "none" else _above_zero(rates, "rates", "0.1,1,20")
    if not (speeds or weights):
        raise InputError("no test to simulate", remedy="give --rates or --loads")
    top_speed, rng = max(speeds, default=1.0), np.random.default_rng([seed, _DRAWN])
    first = next(iter(constants.values()), None)
    hidden = [
        parse_effect(word, first, PROTOCOLS[protocol], top_speed, rng)
        for word in (hide or [])
        if first is not None
    ]
    with waiting("simulating"):
        simulate_file(
            output, constants, speeds, NOISES[noise], seed, max_rows, command_line(), hidden,
            protocol, answer, weights, groups,
        )  # fmt: skip
    out.print(f"wrote {output}")


def _above_zero(text: str, what: str, example: str) -> tuple[float, ...]:
    try:
        values = tuple(float(x) for x in split_names(text))
    except ValueError:
        values = ()
    if not values or min(values) <= 0.0:
        raise InputError(f"{text!r} is not a list of {what}", remedy=f"write for example {example}")
    return values
