"""The settings of a diagnosis in the field's words, one a row."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from qlvbayes.diagnosis.settings import DiagnosisSettings

_SCATTER = {
    "none": "prior probability of no scatter of {}",
    "smallest": "smallest relative sd of {}",
    "largest": "largest relative sd of {}",
    "sizes": "number of relative sds of {} that are tried",
    "typical": "relative sd of {} beyond which the prior falls",
}
WORDS = {
    "complete": "prior probability that no (further) effect is missing",
    "chosen_law": "prior probability of the elastic law that was chosen, and of the relaxation",
    "candidate": "share of an effect's prior probability that its first form has",
    "named": "probability over all hypotheses from which an effect is named",
    "confirmed": "certainty by blind studies below which no effect is named",
    "measured": "certainty of an effect that the readings show beyond doubt",
    "likelier": "probability, free curves included, from which something is taken to be there",
    "covered": "probability with which a group holds the missing effect",
    "false_alarms": "probability that a right model is found to fail",
    "tolerance": "share of the peak force below which effects and errors do not matter",
    "narrowest": "smallest factor by which the prior of an effect's size is fitted to the motion",
    "widest": "largest factor by which it is",
    "group": "largest number of effects in a group",
    "returned": "share of depth or peak force below which a test has come back to zero",
    "breadth.starts": "draws of the priors from which the plain model is optimised",
    "breadth.draws": "draws of the relaxation at once, until they lead no higher",
    "breadth.shapes": "values of a new effect's shape at which its force is tried",
    "breadth.small": "small size at which a new effect's force is tried, in sds of its prior",
    "breadth.large": "large size at which a new effect's force is tried, in sds of its prior",
    "breadth.optimised": "starts from which a new effect is optimised, the most promising ones",
    "breadth.beam": "hypotheses whose neighbours are looked at together",
    "breadth.near": "log probability behind the best within which neighbours are looked at",
    "breadth.redrawn": "neighbours that are also optimised from other relaxations",
    "breadth.effects": "largest number of effects that a hypothesis adds",
    "breadth.substitutes": "effects by which each effect of the best hypothesis is replaced",
    "breadth.hypotheses": "largest number of hypotheses",
    "breadth.modes": "largest number of optima kept for a hypothesis",
    "breadth.far": "log probability behind the best beyond which an optimum is dropped",
    "breadth.rival": "log probability behind the best within which evidence is sampled",
    "breadth.sampled": "largest number of hypotheses whose evidence is sampled",
    "discrepancy.none": "prior probability that the model leaves no systematic error",
    "discrepancy.smallest": "smallest systematic error over the peak force",
    "discrepancy.largest": "largest systematic error over the peak force",
    "discrepancy.sizes": "number of sizes of the systematic error that are tried",
    "discrepancy.rough": "variance of its rough part over that of its smooth part",
    "discrepancy.time": "e-folds of time over which it changes",
    "discrepancy.depth": "share of the largest depth over which it changes",
    "discrepancy.rate": "e-folds of the loading rate over which it changes",
    "discrepancy.unloaded": "its size at zero force over that at the largest force",
    **{f"scatter.{k}": text.format("stiffness and strengths") for k, text in _SCATTER.items()},
    "cells.curves": "smooth curves with which a phase is searched for systematic error",
    "cells.blocks": "averages of readings that each of these curves needs",
    "cells.apart": "phases of one kind in a test that are judged one by one",
    "cells.drifts": "curves by which their mean may drift from cycle to cycle",
    "cells.draws": "draws of the noise over which p-values are averaged",
    "cells.doubtful": "the same where the kind of noise is in doubt",
    "cells.level": "p-value below which a phase stands out",
    **{
        f"imitation.{k}": _SCATTER[k].format("one effect's strength between tests")
        for k in ("largest", "sizes")
    },
    "imitation.ranked": "tests from which a trend of the strengths is looked for",
    "imitation.rank": "rank correlation from which strengths grow or fall with depth or speed",
    "description.shapes": "shapes at which each term of a described law is tried",
    "description.fitted": "terms of a described law that are fitted with all constants",
    "description.judged": "best of these whose predictions of tests left out are judged",
    "description.sds": "standard errors by which tests left out must be predicted better",
    "description.price": "share by which their error must fall for each constant of the law",
}


def settings_rows(settings: DiagnosisSettings) -> list[tuple[str, str]]:
    """Return each setting in words with its value; one that has no words by its name."""
    return [(WORDS.get(name, name), f"{value:g}") for name, value in flat(asdict(settings)).items()]


def flat(settings: dict[str, Any]) -> dict[str, float]:
    """Return settings by name, those of a part as ``breadth.beam``."""
    found: dict[str, float] = {}
    for name, value in settings.items():
        inner = flat(value) if isinstance(value, dict) else {"": value}
        found |= {f"{name}.{key}".rstrip("."): own for key, own in inner.items()}
    return found
