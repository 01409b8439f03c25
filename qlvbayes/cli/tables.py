"""Build the tables that commands print."""

from __future__ import annotations

from collections.abc import Sequence

from rich.table import Table
from rich.text import Text

from qlvbayes.cli.console import table
from qlvbayes.comparison.contrast import Comparison, with_interval, written
from qlvbayes.diagnosis.phrases import parts, stage_name
from qlvbayes.diagnosis.result import DiagnosisResult
from qlvbayes.fitting.residuals import CheckResult
from qlvbayes.fitting.summary import FitSummary
from qlvbayes.io.wording import percent, plain, significant, to_noise, with_ends

_STYLES = {"greater": "bold", "less": "bold", "equal": "green", "cannot tell": "dim"}
_MOST = 8  # most hypotheses in a table


def constants_table(summary: FitSummary) -> Table:
    """Return the table of one pad: every constant with its interval and diagnostics."""
    title = f"pad {summary.pad}: constants, by {summary.sampler}"
    numbers = (">median", ">mean", ">sd", ">90 % interval", ">R-hat", ">ESS")
    made = table(title, "constant", "unit", *numbers)
    for name, c in summary.parameters.items():
        median, low, high = with_ends(c.median, *c.hdi90)
        sd, interval = significant(c.sd, c.sd), f"{low} to {high}"
        made.add_row(
            name, "" if c.unit == "1" else c.unit, median,
            significant(c.mean, c.sd), *(("fixed", "") if c.fixed else (sd, interval)),
            _or_nothing(c.r_hat, ".3f"), _or_nothing(c.ess_bulk, ".0f"),
        )  # fmt: skip
    return made


def constants_line(summary: FitSummary) -> str:
    """Return the line of one pad of many: its constants without those of the noise."""
    shown = [(name, c) for name, c in summary.parameters.items() if not name.startswith("noise.")]
    values = (f"{name} {significant(c.median, c.sd)} ± {plain(c.sd, 2)}" for name, c in shown)
    return f"pad {summary.pad}: {', '.join(values)}"


def pads_table(summaries: Sequence[FitSummary]) -> Table:
    """Return the table of all pads side by side: median (90 % interval)."""
    pads = (f">pad {summary.pad}" for summary in summaries)
    made = table("constants: median (90 % interval)", "constant", "unit", *pads)
    rows: dict[str, str] = {}
    for summary in summaries:
        rows |= {name: c.unit for name, c in summary.parameters.items()}
    for name, unit in rows.items():
        own = [summary.parameters.get(name) for summary in summaries]
        cells = ["{} ({} to {})".format(*with_ends(c.median, *c.hdi90)) if c else "" for c in own]
        made.add_row(name, "" if unit == "1" else unit, *cells)
    return made


def check_table(check: CheckResult, force_unit: str, speed_unit: str) -> Table:
    """Return a pad's table: every test and phase over the noise floor, failing ones marked."""
    title = f"pad {check.pad}: prediction errors, noise floor {plain(check.noise)} {force_unit}"
    names = ("test", "role", "phase")
    made = table(
        title, *names, f">speed ({speed_unit})", ">samples", f">RMSE ({force_unit})",
        ">RMSE/noise", f">bias ({force_unit})", ">in 90 % band", "", whole=names,
    )  # fmt: skip
    before = None
    for c in check.cells:
        if before not in (None, c.test):
            made.add_section()
        before = c.test
        made.add_row(
            c.test, "fitted" if c.role == "fit" else "predicted", c.phase,
            "" if c.rate is None else plain(c.rate), str(c.n), to_noise(c.rmse, check.noise),
            f"{c.rmse / check.noise:.2f}", to_noise(c.bias, check.noise, "+"),
            f"{100 * c.coverage90:.0f} %", Text("fails", style="bold red") if c.fails else "",
        )  # fmt: skip
    return made


def contrasts_table(comparison: Comparison) -> Table:
    """Return a table of both medians, their ratio with its interval, probabilities and answer."""
    one, other = comparison.names
    region = f"region {100 * comparison.region:g} %"
    title = f"{one} against {other}: medians, ratio [90 % interval], {region}"
    made = table(
        title, "quantity", "unit", f">{one}", f">{other}", f">{one}/{other}", ">P(greater)",
        ">P(equal)", "answer", whole=("quantity", "answer"),
    )  # fmt: skip
    before = None
    for c in comparison.contrasts:
        if before not in (None, c.group):
            made.add_section()
        before = c.group
        made.add_row(
            c.quantity + (" *" if c.extrapolated else ""), "" if c.unit == "1" else c.unit,
            written(c.first)[0], written(c.second)[0],
            "" if c.ratio is None else with_interval(c.ratio), f"{c.direction:.3f}",
            f"{c.equivalence:.3f}", Text(c.answer, style=_STYLES[c.answer]),
        )  # fmt: skip
    return made


def steps_table(result: DiagnosisResult, unit: str) -> Table:
    """Return the error after each step against the noise floor."""
    title = f"pad {result.pad}: error after each step, noise floor {plain(result.noise)} {unit}"
    made = table(
        title, "model", f">RMSE ({unit})", f">RMSE on {parts(result)} left out ({unit})",
        ">over noise", ">log evidence",
    )  # fmt: skip
    for stage in result.stages:
        left = stage.heldout_rmse
        heldout = ("one test", "")
        if left is not None:
            heldout = to_noise(left, result.noise), f"{left / result.noise:.2f}"
        made.add_row(
            stage_name(stage, result.stages[0].base), to_noise(stage.rmse, result.noise), *heldout,
            _one_digit(stage.log_evidence),
        )  # fmt: skip
    return made


def ranking_table(result: DiagnosisResult, unit: str) -> Table:
    """Return what the plain model may lack, likeliest first, over all base laws and companions."""
    title = f"pad {result.pad}: what the plain model may lack"
    made = table(
        title, "effect", ">probability", ">certainty", ">log Bayes factor", f">RMSE ({unit})",
        "constants", whole=("effect",),
    )  # fmt: skip
    for ranked in result.ranking[:_MOST]:
        name = "nothing" if ranked.effect == "none" else ranked.effect
        sure = "" if ranked.certainty is None else percent(ranked.certainty)
        factor, error = _one_digit(ranked.log_bayes_factor), to_noise(ranked.rmse, result.noise)
        constants = ", ".join(f"{name} = {e}" for name, e in ranked.parameters.items())
        made.add_row(name, percent(ranked.inclusion), sure, factor, error, constants)
    return made


def _or_nothing(value: float | None, digits: str) -> str:
    return "" if value is None else format(value, digits)


def _one_digit(value: float | None) -> str:
    return "–" if value is None else f"{round(value, 1) + 0.0:.1f}"
