"""The page, put together from its sections."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from qlvbayes.io.escaping import as_typed
from qlvbayes.io.files import write_whole
from qlvbayes.io.wording import joined
from qlvbayes.report.answers import answers, split_first
from qlvbayes.report.boxes import Box, verdict_box
from qlvbayes.report.charts import chart_of
from qlvbayes.report.collect import PadResults, Results, collect
from qlvbayes.report.comparing import comparing_of
from qlvbayes.report.constants import Shifts, constants_rows, shifts_of
from qlvbayes.report.explaining import Explaining, explaining_of
from qlvbayes.report.failing import Failing, failing_of
from qlvbayes.report.figures import Embedder, Figure
from qlvbayes.report.methods import methods_of, source_name
from qlvbayes.report.using import using_of

_PAD_FIGURES = (
    "forces",
    "hysteresis",
    "residuals_before_after",
    "evidence",
    "error_staircase",
    "pairs",
    "programme",
    "forces_before_after",
    "prediction",
)
REPORT = "report.html"


@dataclass(frozen=True)
class PadView:
    """One pad as the page shows it; what was not done is None."""

    name: str
    box: Box
    failing: Failing | None
    chart: dict | None
    explaining: Explaining | None
    shifts: Shifts | None
    figures: dict[str, Figure | None]


def page(results: Results) -> str:
    """The whole HTML text; nothing in it refers to anything outside it."""
    remedies = _remedies(results)
    embed = Embedder(results.out)
    compared = [comparing_of(found) for found in results.comparisons]
    pads = [_view(pad, embed, remedies) for pad in results.pads]
    contrasts = [
        embed(found.folder, "contrasts", f"{view.first} over {view.second}")
        for found, view in zip(results.comparisons, compared, strict=True)
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
    )


def _title(results: Results) -> str:
    names = [pad.name for pad in results.pads]
    return f"{'Pad' if len(names) == 1 else 'Pads'} {joined(names)}"


def _remedies(results: Results) -> dict[str, str]:
    """The command that does each step that may have been left out."""
    out, file = results.out.name or "OUT", source_name(results) or "FILE"
    return {
        "fit": as_typed("qlvbayes", "fit", file, "-o", out),
        "check": as_typed("qlvbayes", "check", out),
        "diagnose": as_typed("qlvbayes", "diagnose", file, "-o", out),
        "compare": as_typed("qlvbayes", "compare", out),
    }


@cache
def _template():  # type: ignore[no-untyped-def]
    environment = Environment(
        loader=PackageLoader("qlvbayes.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals["asset"] = _asset
    environment.filters["split_first"] = split_first
    return environment.get_template("report.html.j2")


def _asset(folder: str, name: str) -> Markup:
    """A file of this package as it stands: styles and scripts, which must not be escaped."""
    return Markup(files("qlvbayes.report").joinpath(folder, name).read_text(encoding="utf-8"))


def write_report(out: str | Path) -> Path:
    """Write ``out/report.html`` from what lies in ``out``; return where it is.

    One file that opens without a network: verdicts, constants, comparisons, errors by test and
    phase, curves to zoom into, missing effects, methods. Steps that were not done are named with
    the command that does them.

    Parameters
    ----------
    out
        The folder of results.

    Returns
    -------
    Path
        Of the page.

    Raises
    ------
    InputError
        There are no results, or a file of them cannot be read.
    """
    folder = Path(out)
    path = folder / REPORT
    write_whole(path, page(collect(folder)).encode())
    return path
