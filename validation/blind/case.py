"""Run one blind study from simulation to verdict, as a dict that is one line of JSON."""

from __future__ import annotations

import time
from dataclasses import asdict

from msgspec import to_builtins

from blind.counting import Case
from blind.population import Population, kin
from blind.study import BlindStudy, make_study
from blind.visible import SEEN, visible
from qlvbayes.diagnosis.diagnose import diagnose
from qlvbayes.diagnosis.result import DiagnosisResult, Estimate, Stage
from qlvbayes.diagnosis.settings import DiagnosisSettings
from qlvbayes.guess.guess import first_guess
from qlvbayes.model.choices import Choices
from qlvbayes.motion.experiment import prepare

THRESHOLDS = DiagnosisSettings()
"""Thresholds with which every study is diagnosed."""
FAILED = "failed"  # in place of a verdict, where the program stopped


def run_case(population: Population, index: int) -> Case:
    """Simulate one study, compute whether its effects can be seen, and diagnose it.

    An error of the diagnosis is stored as the verdict ``failed``, with its text, and counts as
    wrong.
    """
    item = population.item(index)
    case: Case = {"plan": population.key, "index": index, "strata": item.levels}
    case |= {"kind": item.levels["kind"], "names": list(item.names), "seconds": {}}
    case |= {"kin": {name: sorted(kin(name)) for name in item.names}}
    begun = time.perf_counter()
    study = make_study(population, index)
    case |= _truth(study)
    case["detectability"] = visible(study)
    case["seen"] = all(value > SEEN for value in case["detectability"].values())
    between = time.perf_counter()
    choices = Choices(noise="white") if item.levels["noise"] == "white" else Choices()
    try:
        experiment = prepare(study.pad)
        case |= verdict_of(diagnose(experiment, choices, settings=THRESHOLDS).result)
        guess = first_guess(experiment, choices)
        case["guess"] = {name: one.probability for name, one in guess.effects.items()}
    except Exception as error:  # one bad study must not end a run of hundreds
        text = f"{type(error).__name__}: {error}"
        case |= {"verdict": FAILED, "error": text, "effects": [], "group": []}
    case["seconds"] = {"simulate": between - begun, "diagnose": time.perf_counter() - between}
    return case


def _truth(study: BlindStudy) -> dict:
    return {
        "hidden": [
            {"name": effect.name, "size": size, "parameters": effect.parameters}
            for effect, size in zip(study.effects, study.sizes, strict=True)
        ],
        "law": asdict(study.law),
        "cell": asdict(study.cell),
        "rig": {"gap_mm": study.rig.gap, "width_mm": study.rig.width, "creep_mm": study.creep},
        "peak_N": study.peak,
        "rows": [int(t.size) for t in study.times],
        "tests": list(study.session.motions),
    }


def verdict_of(result: DiagnosisResult) -> dict:
    """Return everything of a diagnosis that is needed to score it again, as plain values."""
    return {
        "verdict": result.verdict,
        "settings": to_builtins(result.settings),
        "effects": list(result.effects),
        "group": list(result.group),
        "not_ruled_out": [list(one.effects) for one in result.not_ruled_out],
        "alternatives": [
            [list(one.base.pair), list(one.effects), one.probability] for one in result.alternatives
        ],
        "base": to_builtins(result.base),
        "outside": result.outside,
        "floor": result.noise,
        "log_bayes_factors": {ranked.effect: ranked.log_bayes_factor for ranked in result.ranking},
        "probabilities": {ranked.effect: ranked.inclusion for ranked in result.ranking},
        "support": {one.effect: to_builtins(one.support) for one in result.ranking if one.support},
        "readings": {one.effect: one.half.blocks for one in result.ranking if one.half},
        "refused": [[one.effect, one.reason] for one in result.refused],
        "stages": [_stage(stage) for stage in result.stages],
        "found": _means_and_sds(result.constants),
    }


def _stage(stage: Stage) -> dict:
    return {
        "base": list(stage.base.pair),
        "effects": list(stage.effects),
        "rmse": stage.rmse,
        "heldout_rmse": stage.heldout_rmse,
        "log_evidence": stage.log_evidence,
        "p_value": stage.p_value,
        "testable": stage.testable,
        "parameters": _means_and_sds(stage.parameters),
    }


def _means_and_sds(estimates: dict[str, Estimate]) -> dict[str, list[float]]:
    return {name: [e.mean, e.sd] for name, e in estimates.items()}
