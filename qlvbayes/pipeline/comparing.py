"""Compare pads or fluids of one study and save the comparisons."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path

from qlvbayes.comparison.compare import REGION, compare
from qlvbayes.comparison.contrast import Comparison
from qlvbayes.comparison.writing import write_comparison
from qlvbayes.fitting.results import Saved, load
from qlvbayes.io.checks import InputError
from qlvbayes.io.data import Measurements, read_measurements
from qlvbayes.motion.covered import covered
from qlvbayes.pipeline.watcher import Watcher
from qlvbayes.report.page import MOST_ON_A_PAGE

FOLDER = "compare"
_MOST_PAIRS = 6  # most pairs that a study compares; beyond that the user names them
Group = tuple[str, Sequence[Saved]]


def saved_pads(out: Path, data: Path | None = None, *, only: Sequence[str] = ()) -> list[Saved]:
    """Return the fits of named pads in a folder, by default all; InputError if there are none."""
    names = only or fitted_pads(out)  # of many pads no others are read
    files = [out / name / "posterior.nc" for name in names]
    studies: dict[Path, Measurements] = {}
    return [_with_coverage(load(file), data, studies) for file in files]


def _with_coverage(saved: Saved, data: Path | None, studies: dict[Path, Measurements]) -> Saved:
    source = data or Path(saved.source)
    if saved.covered is not None or not source.is_file():
        return saved
    if source not in studies:
        studies[source] = read_measurements(source)
    pad = studies[source].pad(saved.pad)
    experiment = saved.choices.prepare(pad)
    return replace(saved, covered=covered(experiment), fluid=saved.fluid or pad.fluid)


def fitted_pads(out: Path) -> list[str]:
    """Return the names of the pads whose fits are in a folder; InputError if there are none."""
    names = sorted(file.parent.name for file in out.glob("*/posterior.nc"))
    if not names:
        raise InputError("no fit in this folder", file=out, remedy="run qlvbayes fit first")
    return names


def pad_pairs(pads: Sequence[Saved]) -> list[tuple[Group, Group]]:
    """Return every pair of pads."""
    return list(combinations([(saved.pad, [saved]) for saved in pads], 2))


def fluid_pairs(pads: Sequence[Saved]) -> list[tuple[Group, Group]]:
    """Return every pair of fluids of which there are two specimens or more."""
    fluids: dict[str, list[Saved]] = {}
    for saved in pads:
        if saved.fluid:
            fluids.setdefault(saved.fluid, []).append(saved)
    several = [(fluid, group) for fluid, group in fluids.items() if len(group) > 1]
    return list(combinations(several, 2))


def compare_few(out: Path, pads: Sequence[str], seed: int, watcher: Watcher) -> None:
    """Compare the fluids of some fitted pads, or where there are none every pair of a few pads."""
    if len(pads) > MOST_ON_A_PAGE:
        _leave_out(f"{len(pads)} pads", watcher)
    else:
        compare_pairs(out, [load(out / pad / "posterior.nc") for pad in pads], seed, watcher)


def compare_pairs(out: Path, pads: Sequence[Saved], seed: int, watcher: Watcher) -> None:
    """Compare fluids where several specimens contain them, else every pair of a few pads."""
    pairs = fluid_pairs(pads) or pad_pairs(pads)
    if len(pairs) > _MOST_PAIRS:
        _leave_out(f"{len(pads)} pads make {len(pairs)} pairs, which", watcher)
        return
    for first, second in pairs:
        compare_into(out, first, second, seed=seed, watcher=watcher)


def _leave_out(what: str, watcher: Watcher) -> None:
    watcher.notice(
        f"{what} are not all compared here; name those that matter: qlvbayes compare OUT --pads A,B"
    )


def compare_into(
    out: Path,
    first: Group,
    second: Group,
    *,
    region: float = REGION,
    depth: float | None = None,
    rates: Sequence[float] | None = None,
    frequencies: Sequence[float] | None = None,
    seed: int = 0,
    watcher: Watcher | None = None,
) -> tuple[Comparison, list[Path]]:
    """Compare two groups; leave compare.json, .csv, .tex, .txt and a figure in a folder."""
    names = first[0], second[0]
    folder = out / FOLDER / f"{names[0]}-vs-{names[1]}"
    with (watcher or Watcher()).doing(f"comparing {names[0]} with {names[1]}"):
        comparison = compare(
            first[1],
            second[1],
            names=names,
            region=region,
            depth=depth,
            rates=rates,
            frequencies=frequencies,
            seed=seed,
        )
        write_comparison(folder, comparison)
        figures = _figures(comparison, folder)
    return comparison, figures


def _figures(comparison: Comparison, folder: Path) -> list[Path]:
    # imported here, so that the other steps do not wait for matplotlib
    from qlvbayes.plots.contrasts import plot_contrasts
    from qlvbayes.plots.files import save_figure

    return [save_figure(plot_contrasts(comparison), folder / "contrasts")]
