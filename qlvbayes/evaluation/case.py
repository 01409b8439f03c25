"""One study from simulation to verdict, as a plain dict that is kept as a line of JSON."""

from __future__ import annotations

import time
from dataclasses import asdict
from math import nan

from msgspec import to_builtins
from scipy.special import logit

from qlvbayes.diagnosis.diagnose import diagnose
from qlvbayes.diagnosis.prior import log_odds_of_effect
from qlvbayes.diagnosis.result import DiagnosisResult, Estimate, Stage
from qlvbayes.diagnosis.settings import DiagnosisSettings
from qlvbayes.effects.catalogue import EFFECTS
from qlvbayes.evaluation.detect import SEEN, expected
from qlvbayes.evaluation.plan import Plan, family
from qlvbayes.evaluation.rate import Case
from qlvbayes.evaluation.study import Study, make_study, true_noise, true_values
from qlvbayes.model.choices import Choices
from qlvbayes.preprocess.experiment import prepare

THRESHOLDS = DiagnosisSettings()
"""With which every study of the benchmark is judged."""
DECISIVE = float(logit(THRESHOLDS.named)) - log_odds_of_effect(len(EFFECTS), THRESHOLDS)
"""Log Bayes factor from which an effect is named; the noise must let it pass, for `chance`."""
FAILED = "failed"  # in place of a verdict, where the program stopped


def run_case(plan: Plan, index: int) -> Case:
    """Simulate, see whether it could be seen, diagnose.

    An error of the program is kept as the verdict ``failed``, with its text, and counts as wrong.
    """
    item = plan.item(index)
    case = {"plan": plan.key, **asdict(item), "names": list(item.names), "seen": False}
    case |= {"family": sorted(set().union(*map(family, item.names))), "seconds": {}}
    try:
        _fill(case, make_study(plan, index))
    except Exception as error:  # one bad study must not end a run of hundreds
        text = f"{type(error).__name__}: {error}"
        case |= {"verdict": FAILED, "error": text, "effects": [], "group": []}
    return case


def _fill(case: Case, study: Study) -> None:
    """Add the truth, what could be seen, and the verdict, as far as the program gets."""
    case |= _truth(study)
    begun = time.perf_counter()
    experiment = prepare(study.pad)
    effects = expected(study, experiment)
    case["evidence"] = {name: effect.evidence for name, effect in effects.items()}
    case["seen"] = all(value > SEEN for value in case["evidence"].values())
    least = 2.0 * DECISIVE
    case["chance"] = {name: effect.chance(least) for name, effect in effects.items()}
    between = time.perf_counter()
    found = diagnose(experiment, Choices(noise=study.fitted), settings=THRESHOLDS)
    case |= verdict_of(found.result)
    case["seconds"] = {"detect": between - begun, "diagnose": time.perf_counter() - between}


def _truth(study: Study) -> dict:
    return {
        "hidden": [
            {"name": effect.name, "size": size, "parameters": effect.parameters}
            for effect, size in zip(study.effects, study.sizes, strict=True)
        ],
        "constants": true_values(study.constants),
        "noise": true_noise(study.noise, study.fitted),
        "retracted": list(study.tests.retracted),
    }


def verdict_of(found: DiagnosisResult) -> dict:
    """All of a verdict that a stranger needs to score it again, as plain values."""
    return {
        "verdict": found.verdict,
        "settings": to_builtins(found.settings),
        "effects": list(found.effects),
        "group": list(found.group),
        "not_ruled_out": [list(one.effects) for one in found.not_ruled_out],
        "alternatives": [
            [list(one.base.pair), list(one.effects), one.probability] for one in found.alternatives
        ],
        "base": to_builtins(found.base),
        "outside": found.outside,
        "floor": found.noise,
        "log_bayes_factors": {ranked.effect: ranked.log_bayes_factor for ranked in found.ranking},
        "probabilities": {ranked.effect: ranked.inclusion for ranked in found.ranking},
        "refused": [[one.effect, one.reason] for one in found.refused],
        "stages": [_stage(stage) for stage in found.stages],
        "found": _pairs(found.constants),
    }


def _stage(stage: Stage) -> dict:
    return {
        "base": list(stage.base.pair),
        "effects": list(stage.effects),
        "rmse": stage.rmse,
        "heldout_rmse": nan if stage.heldout_rmse is None else stage.heldout_rmse,
        "log_evidence": stage.log_evidence,
        "p_value": stage.p_value,
        "testable": stage.testable,
        "parameters": _pairs(stage.parameters),
    }


def _pairs(found: dict[str, Estimate]) -> dict[str, list[float]]:
    """Mean and sd by name."""
    return {name: [e.mean, e.sd] for name, e in found.items()}
