"""The fourth question: which effect is missing, how sure, and which test decides."""

from __future__ import annotations

from dataclasses import dataclass

from qlvbayes.diagnosis.phrases import box_line, stage_name
from qlvbayes.diagnosis.result import LawPair, Ranked, Stage
from qlvbayes.io.wording import capitalized, number, percent_unbroken, to_sd, with_unit
from qlvbayes.report.boxes import seen
from qlvbayes.report.collect import PadResults

_MOST = 8  # hypotheses shown


@dataclass(frozen=True)
class StepRow:
    """A model on the way to the verdict."""

    model: str
    rmse: str
    heldout: str
    ratio: str
    evidence: str
    failing: str


@dataclass(frozen=True)
class HypothesisRow:
    """An effect that the baseline model may lack."""

    effect: str
    seen: str
    probability: str
    certainty: str
    bayes: str
    rmse: str
    constants: str
    named: bool


@dataclass(frozen=True)
class Explaining:
    """The diagnosis of one pad."""

    pad: str
    verdict: str
    words: tuple[str, ...]
    steps: tuple[StepRow, ...]
    ranking: tuple[HypothesisRow, ...]
    more: int
    suggestions: tuple[tuple[str, str], ...]
    force_unit: str


def explaining_of(pad: PadResults) -> Explaining | None:
    """Return the results of the diagnosis; None where it was not done."""
    diagnosis = pad.diagnosis
    if diagnosis is None:
        return None
    named = {*diagnosis.effects, *diagnosis.group}
    return Explaining(
        pad.name,
        diagnosis.verdict,
        _paragraphs(pad) or (box_line(diagnosis),),
        tuple(
            _step(stage, diagnosis.stages[0].base, diagnosis.noise) for stage in diagnosis.stages
        ),
        tuple(_hypothesis(ranked, named) for ranked in diagnosis.ranking[:_MOST]),
        max(0, len(diagnosis.ranking) - _MOST),
        tuple((one.test, number(one.evidence, 2)) for one in diagnosis.suggestions),
        pad.force_unit,
    )


def _paragraphs(pad: PadResults) -> tuple[str, ...]:
    """Return the paragraphs of diagnosis.txt below a heading that names the pad."""
    paragraphs = [text.removeprefix(f"Pad {pad.name}: ").replace("+-", "±") for text in pad.words]
    return tuple(capitalized(text) for text in paragraphs)


def _step(stage: Stage, chosen: LawPair, noise: float) -> StepRow:
    heldout = stage.heldout_rmse
    return StepRow(
        stage_name(stage, chosen),
        number(stage.rmse, zeros=True),
        number(heldout, zeros=True),
        number(None if heldout is None else heldout / noise, zeros=True),
        number(stage.log_evidence, 5),
        str(len(stage.failing)),
    )


def _hypothesis(ranked: Ranked, named: set[str]) -> HypothesisRow:
    constants = [
        with_unit(f"{name} = {to_sd(e.mean, e.sd)} ± {to_sd(e.sd, e.sd)}", e.unit)
        for name, e in ranked.parameters.items()
    ]
    none = ranked.effect == "none"
    return HypothesisRow(
        "nothing" if none else ranked.effect,
        "" if none else seen(ranked.effect),
        percent_unbroken(ranked.inclusion),
        "" if ranked.certainty is None else percent_unbroken(ranked.certainty),
        number(ranked.log_bayes_factor),
        number(ranked.rmse, zeros=True),
        ", ".join(constants),
        ranked.effect in named,
    )
