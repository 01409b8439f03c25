"""The fourth question: which effect is missing, how sure, and which test would tell."""

from __future__ import annotations

from dataclasses import dataclass

from qlvbayes.report.boxes import changed_laws, seen, verdict_line
from qlvbayes.report.collect import PadResults
from qlvbayes.report.numbers import number, percent, with_unit

_MOST = 8  # hypotheses shown


@dataclass(frozen=True)
class Step:
    """A model on the way to the verdict."""

    model: str
    rmse: str
    heldout: str
    ratio: str
    evidence: str
    failing: str


@dataclass(frozen=True)
class Hypothesis:
    """What the plain model may lack."""

    effect: str
    seen: str
    probability: str
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
    steps: tuple[Step, ...]
    ranking: tuple[Hypothesis, ...]
    more: int
    suggestions: tuple[tuple[str, str], ...]
    warnings: tuple[str, ...]
    force_unit: str


def explaining_of(pad: PadResults) -> Explaining | None:
    """What the diagnosis found; None where it was not done."""
    found = pad.diagnosis
    if found is None:
        return None
    named = {*found["effects"], *found["group"]}
    return Explaining(
        pad.name,
        found["verdict"],
        _spoken(pad) or (verdict_line(found),),
        tuple(_step(step, found["steps"][0], found["noise_N"]) for step in found["steps"]),
        tuple(_hypothesis(entry, named) for entry in found["ranking"][:_MOST]),
        max(0, len(found["ranking"]) - _MOST),
        tuple(
            (entry["test"], number(entry["expected_2_ln_bayes_factor"], 2))
            for entry in found.get("suggestions", [])
        ),
        tuple(found.get("warnings", [])),
        pad.force_unit,
    )


def _spoken(pad: PadResults) -> tuple[str, ...]:
    """The paragraphs of diagnosis.txt below a heading that names the pad."""
    said = [text.removeprefix(f"Pad {pad.name}: ").replace("+-", "±") for text in pad.words]
    return tuple(f"{text[:1].upper()}{text[1:]}" for text in said)


def _step(step: dict, first: dict, noise: float) -> Step:
    heldout = step["heldout_rmse_N"]
    return Step(
        _model(step, first),
        number(step["rmse_N"], zeros=True),
        number(heldout, zeros=True),
        number(None if heldout is None else heldout / noise, zeros=True),
        number(step["log_evidence"], 5),
        str(len(step.get("failing", []))),
    )


def _model(step: dict, first: dict) -> str:
    """Its laws, where they are not those chosen, and its effects."""
    return " + ".join((", ".join(changed_laws(first, step)) or "plain model", *step["effects"]))


def _hypothesis(entry: dict, named: set[str]) -> Hypothesis:
    constants = [
        with_unit(f"{name} = {number(p['mean'])} ± {number(p['sd'], 1)}", p["unit"])
        for name, p in entry["parameters"].items()
    ]
    none = entry["effect"] == "none"
    return Hypothesis(
        "nothing" if none else entry["effect"],
        "" if none else seen(entry["effect"]),
        percent(entry.get("inclusion", entry["probability"])),
        number(entry["log_bayes_factor"]),
        number(entry["rmse_N"], zeros=True),
        ", ".join(constants),
        entry["effect"] in named,
    )
