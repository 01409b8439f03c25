"""``qlvbayes simulate``: data from the rig simulator."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import Annotated

import typer

from qlvbayes.checks import InputError
from qlvbayes.cli.console import out, waiting
from qlvbayes.cli.options import split_names
from qlvbayes.synthetic import NOISES, pads_of_table_1, simulate_file


def simulate(
    output: Annotated[Path, typer.Option("-o", "--output", help="A .csv or .csv.gz file.")],
    pads: Annotated[str, typer.Option(help="Pads of the paper's Table 1.")] = "A,B,C",
    rates: Annotated[str, typer.Option(help="Loading rates in mm/s.")] = "0.1,1,10,20,30,100",
    noise: Annotated[str, typer.Option(help=f"One of {', '.join(NOISES)}.")] = "correlated",
    max_rows: Annotated[
        int | None, typer.Option(help="Rows a test at most, thinned as a logger does.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Makes a run repeat.")] = 0,
) -> None:
    """Simulate the paper's tests: forward 1.6 mm, hold 30 s, back to 0.8 mm, hold 30 s.

    The platen accelerates at most 1000 mm/s2, the encoder steps by 1 um, the load cell's noise is
    correlated, the record is taken at 1 kHz.
    """
    if noise not in NOISES:
        raise InputError(f"no noise {noise!r}", remedy=f"use one of {', '.join(NOISES)}")
    command = shlex.join(["qlvbayes", *sys.argv[1:]])
    with waiting("simulating"):
        simulate_file(
            output,
            pads_of_table_1(split_names(pads)),
            _rates(rates),
            NOISES[noise],
            seed,
            max_rows,
            command,
        )
    out.print(f"wrote {output}", markup=False)


def _rates(text: str) -> tuple[float, ...]:
    try:
        rates = tuple(float(x) for x in split_names(text))
    except ValueError:
        rates = ()
    if not rates or min(rates) <= 0.0:
        raise InputError(f"{text!r} is not a list of rates", remedy="write for example 0.1,1,20")
    return rates
