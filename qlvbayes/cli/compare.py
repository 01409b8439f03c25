"""``qlvbayes compare``: whether two pads or two fluids differ, in what, and by how much."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from qlvbayes.cli.console import out
from qlvbayes.cli.options import among, known_names, positive_values
from qlvbayes.io.checks import InputError

if TYPE_CHECKING:
    from qlvbayes.fitting.results import Saved
    from qlvbayes.pipeline.derived import Group


def compare(
    folders: list[Path],
    pads: str = "",
    fluids: bool | None = None,
    region: float = 0.1,
    depth: float | None = None,
    rates: str = "",
    frequencies: str = "",
    data: Path | None = None,
    seed: int = 0,
    as_json: bool = False,
) -> None:
    """Compare pads or fluids: every constant, stiffness, forces, times, lost energy, loss tangent.

    Each with its difference and ratio, 90 % intervals, the probability of the direction and of
    practical equivalence, and the answer: greater, less, equal, or cannot tell. Leaves
    OUT/compare/B-vs-C/compare.json, .csv, .tex, .txt and the figure contrasts (PNG and PDF).

    Options:
    folders OUT: The folder that 'fit' or 'study' wrote, or several; results go to the first.
    pads --pads --pad: Two or more pads, as 'B,C'; each pair is compared. Default: all.
    fluids --fluids/--specimens: Compare fluids, with the spread between specimens, or single pads.
        Default: fluids where two of them have two specimens or more.
    region: Ratios from 1/(1 + region) to 1 + region count as equal.
    depth: Depth (first pad's unit). Default: a round one that all tests reach.
    rates: Rates (first pad's unit), as '0.1,1,30'. Default: of the tests' range.
    frequencies: Frequencies (Hz), as '0.1,1'. Default: of the tests' range.
    """
    # imported here, so that the help does not wait for them
    from qlvbayes.cli.tables import contrasts_table
    from qlvbayes.cli.terminal import Terminal, show_figures
    from qlvbayes.pipeline.derived import FOLDER, CompareStep, figure_of

    out_folder = folders[0]
    fits, named = _fits(folders, pads, data)
    step = CompareStep(
        region, depth, positive_values("--rates", rates) or None,
        positive_values("--frequencies", frequencies) or None, seed,
    )  # fmt: skip
    watcher = Terminal(quiet=as_json)
    comparisons = []
    for first, second in _pairs(fits, out_folder, named, fluids):
        comparison = step.run(out_folder, first, second, watcher)
        comparisons.append(comparison)
        if not as_json:
            out.print(contrasts_table(comparison))
            for text in comparison.words:
                out.print(text, soft_wrap=not out.is_terminal)
                out.print()
    if as_json:
        print(json.dumps([one.as_dict() for one in comparisons], allow_nan=False))
    else:
        show_figures([figure_of(out_folder, one) for one in comparisons])
        out.print(f"results in {out_folder / FOLDER}")


def _fits(folders: Sequence[Path], pads: str, data: Path | None) -> tuple[list[Saved], bool]:
    """Return the fits of all folders, and whether they were named.

    Of several folders pads of one name are told apart by their folders' names.
    """
    from qlvbayes.pipeline.derived import fitted_pads, saved_pads

    fits: list[tuple[Path, Saved]] = []
    for folder in dict.fromkeys(folders):
        known = fitted_pads(folder)
        wanted = [name for name in known if name in among(pads, known)]
        if len(folders) == 1:
            wanted = list(dict.fromkeys(known_names(pads, known, folder)))
        if wanted or not pads:
            fits += [(folder, one) for one in saved_pads(folder, wanted, data)]
    if not fits:
        raise InputError(f"no fit of pad '{pads}'", remedy="name pads of these folders")
    names = [one.pad for _, one in fits]
    several = [
        replace(one, pad=f"{folder.resolve().name}-{one.pad}") if names.count(one.pad) > 1 else one
        for folder, one in fits
    ]
    return several, bool(pads) or len(folders) > 1


def _pairs(
    fits: Sequence[Saved], folder: Path, named: bool, fluids: bool | None
) -> list[tuple[Group, Group]]:
    """Return what is compared; raise InputError where there are no two of it, or too many."""
    from qlvbayes.pipeline.derived import fluid_pairs, pad_pairs
    from qlvbayes.report.page import MOST_ON_A_PAGE

    if fluids is None:
        fluids = not named and bool(fluid_pairs(fits))
    if not (fluids or named) and len(fits) > MOST_ON_A_PAGE:
        what = f"{len(fits)} pads make {math.comb(len(fits), 2)} pairs"
        raise InputError(what, file=folder, remedy="name those that matter, as --pads A,B")
    pairs = fluid_pairs(fits) if fluids else pad_pairs(fits)
    if pairs:
        return pairs
    what, remedy = "one fit alone", "fit another pad into this folder"
    if fluids:
        what = "no two fluids have two specimens or more each: how much specimens differ is unknown"
        remedy = "compare single pads with --specimens, or add a fluid column and more pads"
    raise InputError(what, file=folder, remedy=remedy)
