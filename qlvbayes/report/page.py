"""The page, put together from its sections: the results are read once, templates show them."""

from __future__ import annotations

import re
from collections import Counter
from functools import cache, partial
from importlib.resources import files
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from qlvbayes.diagnosis.phrases import BADGES, parts, shown_effects, stage_name
from qlvbayes.fitting.relaxation import RelaxationReport
from qlvbayes.fitting.residuals import over_floor
from qlvbayes.io import wording
from qlvbayes.io.files import write_whole
from qlvbayes.io.wording import NBSP, as_typed, joined, to_sd
from qlvbayes.motion.phases import NAMES
from qlvbayes.parallel.engines import Engine
from qlvbayes.parallel.running import FailedError, run_all
from qlvbayes.plots.catalogue import FIGURES
from qlvbayes.report import collect, questions
from qlvbayes.report.errors import repeated
from qlvbayes.report.figures import Embedder, chart_of
from qlvbayes.report.methods import exports_of, methods_of, source_name, uses_of
from qlvbayes.report.verdicts import answers, verdict_box

_PAD_FIGURES = [one.name for one in FIGURES if one.shows and one.takes is not None]
REPORT = "report.html"
MOST_ON_A_PAGE = 24
"""Pads whose figures are on one page; of more there is a table."""
_CONSTANTS = 12  # columns of constants in that table: those of most pads come first


def page(results: collect.Results) -> str:
    """Return the whole HTML text; nothing in it refers to anything outside it."""
    remedies, embed = _remedies(results), Embedder(results.out)
    compared = [
        (one, embed(one.folder, "contrasts", " over ".join(one.comparison.names)))
        for one in results.comparisons
    ]
    names = [pad.name for pad in results.pads]
    alone = wording.capitalized(results.pads[0].title)
    return _template().render(
        title=alone if len(names) == 1 else f"Pads {joined(names)}",
        source=source_name(results),
        pads=results.pads,
        pictures={
            pad.folder: {name: embed(pad.folder, name, pad.title) for name in _PAD_FIGURES}
            for pad in results.pads
        },
        answers=answers(results, remedies),
        constants=questions.constants_in_units(results.pads),
        meanings=questions.meanings(results.pads),
        compared=compared,
        figures={name: embed(results.out, name) for name in ("constants", "forces_at_rates")},
        methods=methods_of(results),
        uses=uses_of(results),
        exports=exports_of(results),
        remedies=remedies,
    )


def _relaxation(pad: collect.PadResults) -> tuple[str, ...]:
    """Return lines on the tests that were held; none where there are no such tests."""
    fitted = collect.read_if_there(RelaxationReport, pad.folder / "relaxation.json")
    return () if fitted is None else tuple(fitted.text().splitlines())


def _remedies(results: collect.Results) -> dict[str, str]:
    """Return the command of each step that may have been left out."""
    out, file = results.typed, source_name(results) or "FILE"
    fit, diagnose = (as_typed("qlvbayes", step, file, "-o", out) for step in ("fit", "diagnose"))
    check, compare = (as_typed("qlvbayes", step, out) for step in ("check", "compare"))
    if not any(pad.final.summary for pad in results.pads):
        for step, run in results.runs.items():  # as it was typed, with the options of the model
            fit = run.command.replace(f"qlvbayes {step}", "qlvbayes study", 1)
        check = compare = fit
    return {"fit": fit, "check": check, "diagnose": diagnose, "compare": compare}


@cache
def _template(name: str = "report"):  # type: ignore[no-untyped-def]
    environment = Environment(
        loader=PackageLoader("qlvbayes.report"), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    environment.globals |= {
        "asset": _asset, "phase_names": NAMES, "repeated": repeated, "stage_name": stage_name,
        "parts_of": parts, "box_of": verdict_box, "chart_of": chart_of,
        "shifts_of": questions.shifts_of, "relaxation_of": _relaxation,
        "compared_words": questions.compared_words, "diagnosis_words": questions.diagnosis_words,
        "answer_kinds": questions.KINDS, "ends": wording.ends,
    }  # fmt: skip
    environment.filters |= {
        "split_first": _split_first, "seen": questions.seen, "number": wording.number,
        "percent": wording.percent_unbroken, "to_sd": wording.to_sd,
        "with_unit": wording.with_unit, "parted": _parted, "titled": wording.capitalized,
    }  # fmt: skip
    return environment.get_template(f"{name}.html.j2")


def _split_first(text: str) -> tuple[str, str]:
    """Return the first sentence, and the rest; no line breaks within a share."""
    for sign in (" %", "> 99.9", "< 0.1"):
        text = text.replace(sign, sign.replace(" ", NBSP))
    head, stop, rest = text.partition(". ")
    return (f"{head}.", rest) if stop else (text, "")


def _parted(name: str) -> Markup:
    """Return a name that may break into lines after a point or an underscore."""
    return Markup(re.sub(r"(?<=[._])", "<wbr>", escape(name)))


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
    if len(folders := collect.pad_folders(folder)) <= MOST_ON_A_PAGE:
        write_whole(path, page(collect.collect(folder)).encode())
        return path
    old = [one for one in folders if _is_older(one)]
    shared = engine if engine is not None and engine.shares_disk else None
    for outcome in run_all(partial(_write_own, folder), old, shared):
        if outcome.fault is not None:
            raise FailedError([outcome.fault], 1)
    rows = [_overview_row(collect.pad_in(one)) for one in folders]
    constants = Counter(name for row in rows for name in row["constants"])
    text = _template("overview").render(
        title=f"{len(folders)} pads", rows=rows,
        verdicts=Counter(row["verdict"] for row in rows).most_common(),
        constants=[name for name, _ in constants.most_common(_CONSTANTS)],
        commands=[run.command for run in collect.runs_in(folder).values()],
    )  # fmt: skip
    write_whole(path, text.encode())
    return path


def _write_own(out: Path, folder: Path) -> None:
    """Write the page of one pad of many into its own folder."""
    results = collect.Results(folder, (collect.pad_in(folder),), (), collect.runs_in(out))
    write_whole(folder / REPORT, page(results).encode())


def _is_older(folder: Path) -> bool:
    """Return whether a pad's page is missing, or older than its results."""
    made = (page := folder / REPORT).exists() and page.stat().st_mtime_ns
    return any(f.stat().st_mtime_ns > made for m in collect.MARKS if (f := folder / m).exists())


def _overview_row(pad: collect.PadResults) -> dict[str, Any]:
    check, d = pad.final.check, pad.diagnosis
    over = [over_floor(cell, check.noise) for cell in check.cells] if check else []
    constants = {  # medians, as they are shown and as values to sort by
        f"{name} ({c.unit})" if c.unit != "1" else name: (to_sd(c.median, c.sd), c.median)
        for name, c in pad.parameters.items()
        if not name.startswith("noise.")
    }
    return {
        "pad": pad.name, "folder": pad.folder.name, "fluid": pad.fluid or "",
        "verdict": BADGES[d.verdict] if d else "not diagnosed",
        "named": ", ".join(shown_effects(d)) if d else "",
        "fails": len(check.failing) if check else None,  # phases with structure beyond noise
        "worst": wording.number(max(over), 2) if over else "", "constants": constants,
    }  # fmt: skip
