"""Tables for people."""

from __future__ import annotations

from collections.abc import Sequence
from math import floor, log10

from rich.table import Table
from rich.text import Text

from qlvbayes.fitting.residuals import CheckResult
from qlvbayes.fitting.summary import Constant, FitSummary
from qlvbayes.io.wording import plain


def significant(value: float, sd: float) -> str:
    """A number with two digits of its sd (four significant ones where it has none)."""
    if sd <= 0.0:
        return f"{value:.4g}"
    return f"{value:.{max(0, 1 - floor(log10(sd)))}f}"


def constants_table(summary: FitSummary) -> Table:
    """One pad: every constant with its interval and diagnostics."""
    title = f"pad {summary.pad}, {summary.sampler}"
    table = Table(title=title, title_justify="left", title_style="bold")
    table.add_column("constant")
    table.add_column("unit")
    for head in ("median", "mean", "sd", "90 % interval", "R-hat", "ESS"):
        table.add_column(head, justify="right")
    for name, c in summary.parameters.items():
        table.add_row(
            name,
            "" if c.unit == "1" else c.unit,
            significant(c.median, c.sd),
            significant(c.mean, c.sd),
            "fixed" if c.fixed else f"{c.sd:.2g}",
            _interval(c),
            "" if c.r_hat is None else f"{c.r_hat:.3f}",
            "" if c.ess_bulk is None else f"{c.ess_bulk:.0f}",
        )
    return table


def _interval(c: Constant) -> str:
    low, high = (significant(x, c.sd) for x in c.hdi90)
    return "" if c.fixed else f"{low} to {high}"


def pads_table(summaries: Sequence[FitSummary]) -> Table:
    """All pads side by side: median (90 % interval)."""
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
        cells = [_cell(summary.parameters.get(name)) for summary in summaries]
        table.add_row(name, "" if unit == "1" else unit, *cells)
    return table


def _cell(c: Constant | None) -> str:
    if c is None:
        return ""
    low, high = (significant(x, c.sd) for x in c.hdi90)
    return f"{significant(c.median, c.sd)} ({low} to {high})"


def _error(value: float, noise: float, sign: str = "") -> str:
    """To a hundredth of the noise's first digit; '2.3e-08' where that takes too many decimals."""
    places = max(0, 2 - floor(log10(noise))) if noise > 0.0 else 4
    return f"{value:{sign}.{places}f}" if places <= 6 else f"{value:{sign}.2g}"


def check_table(check: CheckResult, force_unit: str, speed_unit: str) -> Table:
    """One pad: every cell of test and phase against the noise floor, failing ones marked."""
    title = f"pad {check.pad}: prediction errors, noise floor {plain(check.noise)} {force_unit}"
    table = Table(title=title, title_justify="left", title_style="bold")
    for name in ("test", "role", "phase"):
        table.add_column(name, no_wrap=True, overflow="fold")
    for name in (
        f"rate {speed_unit}",
        "n",
        f"RMSE {force_unit}",
        "RMSE/noise",
        f"bias {force_unit}",
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
            c.role,
            c.phase,
            "" if c.rate is None else plain(c.rate),
            str(c.n),
            _error(c.rmse, check.noise),
            f"{c.rmse / check.noise:.2f}",
            _error(c.bias, check.noise, "+"),
            f"{100 * c.coverage90:.0f} %",
            Text("fails", style="bold red") if c.fails else "",
        )
    return table
