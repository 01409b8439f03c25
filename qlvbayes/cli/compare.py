"""``qlvbayes compare``: whether two pads or two fluids differ, in what, and by how much."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from qlvbayes.cli.console import out
from qlvbayes.cli.options import AsJson, Fitted, Seed, Style, known_names, split_names
from qlvbayes.io.checks import InputError

if TYPE_CHECKING:
    from qlvbayes.fitting.results import Saved
    from qlvbayes.pipeline.comparing import Group


def compare_command(
    folder: Fitted,
    pads: Annotated[
        str, typer.Option(help="Two or more pads, as 'B,C'; each pair is compared. Default: all.")
    ] = "",
    fluids: Annotated[
        bool | None,
        typer.Option(
            "--fluids/--specimens",
            help="Compare fluids, with the spread between specimens, or single pads. Default: "
            "fluids where two of them have two specimens or more.",
        ),
    ] = None,
    region: Annotated[
        float, typer.Option(help="Ratios from 1/(1 + region) to 1 + region count as equal.")
    ] = 0.1,
    depth: Annotated[
        float | None,
        typer.Option(help="Depth (first pad's unit). Default: a round one that all tests reach."),
    ] = None,
    rates: Annotated[
        str,
        typer.Option(help="Rates (first pad's unit), as '0.1,1,30'. Default: of the tests' range."),
    ] = "",
    frequencies: Annotated[
        str, typer.Option(help="Frequencies (Hz), as '0.1,1'. Default: of the tests' range.")
    ] = "",
    data: Annotated[
        Path | None, typer.Option(help="The measurements, if the fits do not say what they cover.")
    ] = None,
    style: Style = None,
    seed: Seed = 0,
    as_json: AsJson = False,
) -> None:
    """Compare pads or fluids: every constant, stiffness, forces, times, lost energy, loss tangent.

    Each with its difference and ratio, 90 % intervals, the probability of the direction and of
    practical equivalence, and the answer: greater, less, equal, or cannot tell. Leaves
    OUT/compare/B-vs-C/compare.json, .csv, .tex, .txt and the figure contrasts (PNG and PDF).
    """
    # imported here, so that the help does not wait for them
    from qlvbayes.cli.tables import contrasts_table
    from qlvbayes.cli.terminal import Terminal, show_figures
    from qlvbayes.pipeline.comparing import FOLDER, compare_into, fitted_pads, saved_pads

    names = list(dict.fromkeys(known_names(pads, fitted_pads(folder), folder)))
    pairs = _pairs(saved_pads(folder, data, only=names), folder, bool(names), fluids)
    watcher = Terminal(quiet=as_json)
    contents, figures = [], []
    for first, second in pairs:
        comparison, drawn = compare_into(
            folder,
            first,
            second,
            region=region,
            depth=depth,
            rates=_positive_values("--rates", rates),
            frequencies=_positive_values("--frequencies", frequencies),
            seed=seed,
            watcher=watcher,
        )
        contents.append(comparison.as_dict())
        figures += drawn
        if not as_json:
            out.print(contrasts_table(comparison))
            for text in comparison.words:
                out.print(text, soft_wrap=not out.is_terminal)
                out.print()
    if as_json:
        print(json.dumps(contents, allow_nan=False))
    else:
        show_figures(figures)
        out.print(f"results in {folder / FOLDER}")


def _pairs(
    fits: Sequence[Saved], folder: Path, named: bool, fluids: bool | None
) -> list[tuple[Group, Group]]:
    """Return what is compared; raise InputError where there are no two of it, or too many."""
    from qlvbayes.pipeline.comparing import fluid_pairs, pad_pairs
    from qlvbayes.report.page import MOST_ON_A_PAGE

    if fluids is None:
        fluids = not named and bool(fluid_pairs(fits))
    if not (fluids or named) and len(fits) > MOST_ON_A_PAGE:
        raise InputError(
            f"{len(fits)} pads make {math.comb(len(fits), 2)} pairs",
            file=folder,
            remedy="name those that matter, as --pads A,B",
        )
    pairs = fluid_pairs(fits) if fluids else pad_pairs(fits)
    if pairs:
        return pairs
    if fluids:
        raise InputError(
            "no two fluids have two specimens or more each: how much specimens differ is unknown",
            file=folder,
            remedy="compare single pads with --specimens, or add a fluid column and more pads",
        )
    raise InputError("one fit alone", file=folder, remedy="fit another pad into this folder")


def _positive_values(option: str, text: str) -> list[float] | None:
    try:
        values = [float(word) for word in split_names(text)]
    except ValueError:
        values = [math.nan]
    if not all(math.isfinite(x) and x > 0.0 for x in values):
        raise InputError(f"{option} {text!r} are not numbers above 0", remedy="write as '0.1,1,30'")
    return values or None
