"""Tables of a diagnosis for people."""

from __future__ import annotations

from rich.table import Table

from qlvbayes.diagnosis.result import DiagnosisResult, Estimate, Laws, Ranked, Stage
from qlvbayes.io.wording import plain

_MOST = 8  # hypotheses shown


def steps_table(found: DiagnosisResult, unit: str) -> Table:
    """The error after each step against the noise floor."""
    title = f"pad {found.pad}: error after each step, noise floor {plain(found.noise)} {unit}"
    table = Table(title=title, title_justify="left", title_style="bold")
    table.add_column("model")
    for name in (f"RMSE {unit}", f"held-out RMSE {unit}", "held-out/noise", "log evidence"):
        table.add_column(name, justify="right")
    table.add_column("cells that fail", justify="right")
    for stage in found.stages:
        table.add_row(
            _model(stage, found.stages[0].base),
            plain(stage.rmse, 4),
            "one test" if stage.heldout_rmse is None else plain(stage.heldout_rmse, 4),
            "" if stage.heldout_rmse is None else f"{stage.heldout_rmse / found.noise:.2f}",
            _one_digit(stage.log_evidence),
            str(len(stage.failing)),
        )
    return table


def ranking_table(found: DiagnosisResult, unit: str) -> Table:
    """What the plain model may lack, likeliest first, over all base laws and companions."""
    table = Table(title="what the plain model may lack", title_justify="left", title_style="bold")
    table.add_column("effect", no_wrap=True)
    for name in ("probability", "log Bayes factor", f"RMSE {unit}"):
        table.add_column(name, justify="right")
    table.add_column("constants")
    for ranked in found.ranking[:_MOST]:
        name = "nothing" if ranked.effect == "none" else ranked.effect
        table.add_row(name, f"{ranked.inclusion:.3f}", *_figures(ranked))
    return table


def _model(stage: Stage, chosen: Laws) -> str:
    """Its laws, where they are not those chosen, and its effects."""
    return " + ".join((", ".join(stage.base.others(chosen)) or "QLV", *stage.effects))


def _figures(ranked: Ranked) -> tuple[str, str, str]:
    return (
        _one_digit(ranked.log_bayes_factor),
        plain(ranked.rmse, 4),
        ", ".join(_constant(name, e) for name, e in ranked.parameters.items()),
    )


def _constant(name: str, e: Estimate) -> str:
    return f"{name} = {e}"


def _one_digit(value: float | None) -> str:
    return "n/a" if value is None else f"{value:.1f}"
