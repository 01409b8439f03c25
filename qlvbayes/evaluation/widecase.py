"""One study of the wide population from simulation to verdict, as a plain dict."""

from __future__ import annotations

import time
from dataclasses import asdict
from typing import Any

from qlvbayes.diagnosis.diagnose import diagnose
from qlvbayes.evaluation.case import FAILED, THRESHOLDS, verdict_of
from qlvbayes.evaluation.population import Population, kin
from qlvbayes.evaluation.rate import Case
from qlvbayes.evaluation.visible import SEEN, visible
from qlvbayes.evaluation.wide import WideStudy, make_wide
from qlvbayes.model.choices import Choices
from qlvbayes.preprocess.experiment import prepare


def run_wide(population: Population, index: int) -> Case:
    """Simulate, see whether it could be seen, diagnose with the defaults.

    An error of the program is kept as the verdict ``failed``, with its text, and counts as wrong.
    """
    item = population.item(index)
    case: dict[str, Any] = {"plan": population.key, "index": index, "strata": item.levels}
    case |= {"kind": item.levels["kind"], "names": list(item.names), "seconds": {}}
    case |= {"kin": {name: sorted(kin(name)) for name in item.names}}
    begun = time.perf_counter()
    study = make_wide(population, index)
    case |= _truth(study)
    case["detectability"] = visible(study)
    case["seen"] = all(value > SEEN for value in case["detectability"].values())
    between = time.perf_counter()
    try:
        case |= verdict_of(diagnose(prepare(study.pad), Choices(), settings=THRESHOLDS).result)
    except Exception as error:  # one bad study must not end a run of hundreds
        text = f"{type(error).__name__}: {error}"
        case |= {"verdict": FAILED, "error": text, "effects": [], "group": []}
    case["seconds"] = {"simulate": between - begun, "diagnose": time.perf_counter() - between}
    return case


def _truth(study: WideStudy) -> dict:
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
