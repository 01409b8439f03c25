"""The page, put together from its sections."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, partial
from importlib.resources import files
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from qlvbayes.fitting.relaxation import RelaxationReport
from qlvbayes.io.escaping import as_typed
from qlvbayes.io.files import write_whole
from qlvbayes.io.wording import joined
from qlvbayes.parallel.engines import Engine
from qlvbayes.parallel.faults import FailedError
from qlvbayes.parallel.running import run_all
from qlvbayes.plots.catalogue import FIGURES
from qlvbayes.report.answers import answers, split_first
from qlvbayes.report.boxes import Box, verdict_box
from qlvbayes.report.charts import chart_of
from qlvbayes.report.collect import (
    PadResults,
    Results,
    collect,
    pad_folders,
    pad_in,
    read_if_there,
    runs_in,
)
from qlvbayes.report.comparing import comparing_of
from qlvbayes.report.constants import Shifts, constants_rows, shifts_of
from qlvbayes.report.explaining import Explaining, explaining_of
from qlvbayes.report.failing import Failing, failing_of
from qlvbayes.report.figures import Embedder, Picture
from qlvbayes.report.methods import methods_of, source_name
from qlvbayes.report.overview import is_older, overview_of
from qlvbayes.report.using import using_of

_PAD_FIGURES = [one.name for one in FIGURES if one.shows and one.takes is not None]
REPORT = "report.html"
MOST_ON_A_PAGE = 24
"""Pads whose figures are on one page; of more there is a table."""


@dataclass(frozen=True)
class PadView:
    """A pad as the page shows it; what was not done is None."""

    name: str
    box: Box
    failing: Failing | None
    chart: dict | None
    explaining: Explaining | None
    shifts: Shifts | None
    figures: dict[str, Picture | None]
    relaxation: tuple[str, ...]


def page(results: Results) -> str:
    """Return the whole HTML text; nothing in it refers to anything outside it."""
    remedies = _remedies(results)
    embed = Embedder(results.out)
    compared = [comparing_of(comparison) for comparison in results.comparisons]
    pads = [_view(pad, embed, remedies) for pad in results.pads]
    contrasts = [
        embed(comparison.folder, "contrasts", f"{view.first} over {view.second}")
        for comparison, view in zip(results.comparisons, compared, strict=True)
    ]
    return _template().render(
        title=_title(results),
        source=source_name(results),
        pads=pads,
        answers=answers(results, compared, remedies),
        constants=constants_rows(results.pads),
        compared=list(zip(compared, contrasts, strict=True)),
        figures={name: embed(results.out, name) for name in ("constants", "forces_at_rates")},
        methods=methods_of(results),
        using=using_of(results),
        remedies=remedies,
    )


def _view(pad: PadResults, embed: Embedder, remedies: dict[str, str]) -> PadView:
    of = f"pad {pad.name}"
    return PadView(
        pad.name,
        verdict_box(pad, remedies["diagnose"]),
        failing_of(pad),
        chart_of(pad),
        explaining_of(pad),
        shifts_of(pad),
        {name: embed(pad.folder, name, of) for name in _PAD_FIGURES},
        _relaxation(pad),
    )


def _relaxation(pad: PadResults) -> tuple[str, ...]:
    """Return lines on the tests that were held; none where there are no such tests."""
    fitted = read_if_there(RelaxationReport, pad.folder / "relaxation.json")
    return () if fitted is None else tuple(fitted.text().splitlines())


def _title(results: Results) -> str:
    names = [pad.name for pad in results.pads]
    return f"{'Pad' if len(names) == 1 else 'Pads'} {joined(names)}"


def _remedies(results: Results) -> dict[str, str]:
    """Return the command of each step that may have been left out."""
    out, file = results.out.name or "OUT", source_name(results) or "FILE"
    return {
        "fit": as_typed("qlvbayes", "fit", file, "-o", out),
        "check": as_typed("qlvbayes", "check", out),
        "diagnose": as_typed("qlvbayes", "diagnose", file, "-o", out),
        "compare": as_typed("qlvbayes", "compare", out),
    }


@cache
def _template(name: str = "report"):  # type: ignore[no-untyped-def]
    environment = Environment(
        loader=PackageLoader("qlvbayes.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals["asset"] = _asset
    environment.filters["split_first"] = split_first
    return environment.get_template(f"{name}.html.j2")


def _asset(folder: str, name: str) -> Markup:
    """Return a file of this package as it stands: styles and scripts, which must not be escaped."""
    return Markup(files("qlvbayes.report").joinpath(folder, name).read_text(encoding="utf-8"))


def write_report(out: str | Path, *, engine: Engine | None = None) -> Path:
    """Write ``out/report.html`` from what lies in ``out``; return where it is.

    One file that opens without a network: verdicts, constants, comparisons, errors by test and
    phase, curves to zoom into, missing effects, methods. Steps that were not done are named with
    the command that does them. Of more than 24 pads it is a table to search, and each pad has such
    a page in its own folder. An InputError where there are no results, or one cannot be read.

    Parameters
    ----------
    out, engine
        The folder of results, and what makes many pages (this process where it is None).
    """
    folder = Path(out)
    path = folder / REPORT
    if len(folders := pad_folders(folder)) <= MOST_ON_A_PAGE:
        write_whole(path, page(collect(folder)).encode())
        return path
    old = [one for one in folders if is_older(one / REPORT, one)]
    shared = engine if engine is not None and engine.shares_disk else None
    for outcome in run_all(partial(_write_own, folder), old, shared):
        if outcome.fault is not None:
            raise FailedError([outcome.fault], 1)
    overview = overview_of(folders)
    commands = [run.command for run in runs_in(folder).values()]
    text = _template("overview").render(
        title=f"{len(folders)} pads", overview=overview, commands=commands
    )
    write_whole(path, text.encode())
    return path


def _write_own(out: Path, folder: Path) -> None:
    """Write the page of one pad of many into its own folder."""
    results = Results(folder, (pad_in(folder),), (), runs_in(out))
    write_whole(folder / REPORT, page(results).encode())
