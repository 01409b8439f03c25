"""Build the tables that commands print."""

from __future__ import annotations

from collections.abc import Sequence

from rich.table import Table
from rich.text import Text

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
    table = Table(title=title, title_justify="left", title_style="bold")
    table.add_column("constant")
    table.add_column("unit")
    for head in ("median", "mean", "sd", "90 % interval", "R-hat", "ESS"):
        table.add_column(head, justify="right")
    for name, c in summary.parameters.items():
        median, low, high = with_ends(c.median, *c.hdi90)
        table.add_row(
            name,
            "" if c.unit == "1" else c.unit,
            median,
            significant(c.mean, c.sd),
            "fixed" if c.fixed else significant(c.sd, c.sd),
            "" if c.fixed else f"{low} to {high}",
            "" if c.r_hat is None else f"{c.r_hat:.3f}",
            "" if c.ess_bulk is None else f"{c.ess_bulk:.0f}",
        )
    return table


def constants_line(summary: FitSummary) -> str:
    """Return the line of one pad of many: its constants without those of the noise."""
    shown = [(name, c) for name, c in summary.parameters.items() if not name.startswith("noise.")]
    values = ", ".join(
        f"{name} {significant(c.median, c.sd)} ± {plain(c.sd, 2)}" for name, c in shown
    )
    return f"pad {summary.pad}: {values}"


def pads_table(summaries: Sequence[FitSummary]) -> Table:
    """Return the table of all pads side by side: median (90 % interval)."""
    table = Table(
        title="constants: median (90 % interval)", title_justify="left", title_style="bold"
    )
    table.add_column("constant")
    table.add_column("unit")
    for summary in summaries:
        table.add_column(f"pad {summary.pad}", justify="right")
    rows: dict[str, str] = {}
    for summary in summaries:
        rows |= {name: c.unit for name, c in summary.parameters.items()}
    for name, unit in rows.items():
        own = [summary.parameters.get(name) for summary in summaries]
        cells = ["{} ({} to {})".format(*with_ends(c.median, *c.hdi90)) if c else "" for c in own]
        table.add_row(name, "" if unit == "1" else unit, *cells)
    return table


def check_table(check: CheckResult, force_unit: str, speed_unit: str) -> Table:
    """Return a pad's table: every test and phase over the noise floor, failing ones marked."""
    title = f"pad {check.pad}: prediction errors, noise floor {plain(check.noise)} {force_unit}"
    table = Table(title=title, title_justify="left", title_style="bold")
    for name in ("test", "role", "phase"):
        table.add_column(name, no_wrap=True, overflow="fold")
    for name in (
        f"speed ({speed_unit})",
        "samples",
        f"RMSE ({force_unit})",
        "RMSE/noise",
        f"bias ({force_unit})",
        "in 90 % band",
    ):
        table.add_column(name, justify="right")
    table.add_column("")
    before = None
    for c in check.cells:
        if before not in (None, c.test):
            table.add_section()
        before = c.test
        table.add_row(
            c.test,
            "fitted" if c.role == "fit" else "predicted",
            c.phase,
            "" if c.rate is None else plain(c.rate),
            str(c.n),
            to_noise(c.rmse, check.noise),
            f"{c.rmse / check.noise:.2f}",
            to_noise(c.bias, check.noise, "+"),
            f"{100 * c.coverage90:.0f} %",
            Text("fails", style="bold red") if c.fails else "",
        )
    return table


def contrasts_table(comparison: Comparison) -> Table:
    """Return a table of both medians, their ratio with its interval, probabilities and answer."""
    one, other = comparison.names
    region = f"region {100 * comparison.region:g} %"
    title = f"{one} against {other}: medians, ratio [90 % interval], {region}"
    table = Table(title=title, title_justify="left", title_style="bold")
    table.add_column("quantity", no_wrap=True)
    table.add_column("unit")
    for name in (one, other, f"{one}/{other}", "P(greater)", "P(equal)"):
        table.add_column(name, justify="right")
    table.add_column("answer", no_wrap=True)
    before = None
    for c in comparison.contrasts:
        if before not in (None, c.group):
            table.add_section()
        before = c.group
        table.add_row(
            c.quantity + (" *" if c.extrapolated else ""),
            "" if c.unit == "1" else c.unit,
            written(c.first)[0],
            written(c.second)[0],
            "" if c.ratio is None else with_interval(c.ratio),
            f"{c.direction:.3f}",
            f"{c.equivalence:.3f}",
            Text(c.answer, style=_STYLES[c.answer]),
        )
    return table


def steps_table(result: DiagnosisResult, unit: str) -> Table:
    """Return the error after each step against the noise floor."""
    title = f"pad {result.pad}: error after each step, noise floor {plain(result.noise)} {unit}"
    table = Table(title=title, title_justify="left", title_style="bold")
    table.add_column("model")
    for name in (
        f"RMSE ({unit})",
        f"RMSE on {parts(result)} left out ({unit})",
        "over noise",
        "log evidence",
    ):
        table.add_column(name, justify="right")
    for stage in result.stages:
        table.add_row(
            stage_name(stage, result.stages[0].base),
            to_noise(stage.rmse, result.noise),
            "one test"
            if stage.heldout_rmse is None
            else to_noise(stage.heldout_rmse, result.noise),
            "" if stage.heldout_rmse is None else f"{stage.heldout_rmse / result.noise:.2f}",
            _one_digit(stage.log_evidence),
        )
    return table


def ranking_table(result: DiagnosisResult, unit: str) -> Table:
    """Return what the plain model may lack, likeliest first, over all base laws and companions."""
    title = f"pad {result.pad}: what the plain model may lack"
    table = Table(title=title, title_justify="left", title_style="bold")
    table.add_column("effect", no_wrap=True)
    for name in ("probability", "certainty", "log Bayes factor", f"RMSE ({unit})"):
        table.add_column(name, justify="right")
    table.add_column("constants")
    for ranked in result.ranking[:_MOST]:
        name = "nothing" if ranked.effect == "none" else ranked.effect
        sure = "" if ranked.certainty is None else percent(ranked.certainty)
        factor, error = _one_digit(ranked.log_bayes_factor), to_noise(ranked.rmse, result.noise)
        constants = ", ".join(f"{name} = {e}" for name, e in ranked.parameters.items())
        table.add_row(name, percent(ranked.inclusion), sure, factor, error, constants)
    return table


def _one_digit(value: float | None) -> str:
    return "–" if value is None else f"{round(value, 1) + 0.0:.1f}"
