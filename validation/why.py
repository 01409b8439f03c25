"""Find why the wrong verdicts of a registered run were wrong, and write a page.

`why.py RUN` takes every study of docs/wide_RUN.json that could be seen and whose verdict was wrong,
simulates it again, diagnoses it with the present code, fits what is really hidden from its true
constants, and gives a cause (`causes`). Interrupted, the same command goes on where it was; the
quickest studies come first. `--part 0` and `--part 1` run in two processes and write no page;
`--finished` writes what there is, `--keep` with what earlier code left on the page for the others.
"""

from __future__ import annotations

import argparse
import json
import math
import shlex
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from causes import RIGHT, Compared, carrying_half, one_by_one
from numpy.typing import NDArray
from page import Origin
from registration import Registration
from starts import around
from truth import Rig, Truth, truths
from why_page import why_page

from qlvbayes.cli.console import counting
from qlvbayes.diagnosis.candidate import candidate_at, described
from qlvbayes.diagnosis.checks.adequacy import adequacy
from qlvbayes.diagnosis.diagnose import diagnose
from qlvbayes.diagnosis.search import Search
from qlvbayes.diagnosis.summary.diagnosis import Diagnosis
from qlvbayes.evaluation.case import THRESHOLDS, verdict_of
from qlvbayes.evaluation.counting import Case, is_right, names_wrongly
from qlvbayes.evaluation.population import Population
from qlvbayes.evaluation.store import Store, run_missing, store_path
from qlvbayes.evaluation.study import BlindStudy, make_study
from qlvbayes.inference.density import Density, Point
from qlvbayes.inference.forward.hypothesis import Hypothesis
from qlvbayes.inference.modes import Mode, distinct, find_modes
from qlvbayes.io.files import write_json, write_whole
from qlvbayes.model.choices import Choices
from qlvbayes.motion.experiment import Experiment, prepare

ROOT = Path(__file__).resolve().parents[1]
Array = NDArray[np.float64]

_PARTS = 2
_REDRAWN = 5  # starts with the relaxation drawn anew,
_MOVED = 4  # and with all numbers moved: ten with the truth itself
_SHOWN = 3  # readings that are listed
_OUTSIDE = ("outside", "outside_beside")
_NOTHING_ELSE = ("adequate", "missing_effect", "ambiguous")
"""Verdicts that nothing unlisted is there."""


def main() -> None:
    options = _options()
    run = json.loads((ROOT / "docs" / f"wide_{options.run}.json").read_text(encoding="utf-8"))
    wrong = [case for case in run["cases"] if case["seen"] and not is_right(case)]
    wanted = _wanted(wrong, options)
    store = Store(
        store_path(ROOT / "build" / "validation", f"why-{options.run}"), options.run, options.part
    )
    if not options.finished:
        population = Registration.read(options.run).population
        with counting("studies") as report:
            by_index = {case["index"]: case for case in wanted}
            run_missing(
                lambda index: explained(options.run, population, by_index[index]), store,
                by_index, report,
            )  # fmt: skip
    if options.part is None:
        kept = _published(options.output.with_suffix(".json")) if options.keep else {}
        cases = kept | store.cases
        _publish(options, [cases[c["index"]] for c in wrong if c["index"] in cases], len(wrong))


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", help="name of the run, of docs/wide_RUN.json")
    parser.add_argument("--studies", type=int, help="so many, the quickest first")
    parser.add_argument("--only", help="numbers of studies, as 3,17")
    parser.add_argument("--part", type=int, choices=range(_PARTS), help="every second study")
    parser.add_argument("--finished", action="store_true", help="write the page, run nothing")
    parser.add_argument("--keep", action="store_true", help="others as they are on the page")
    parser.add_argument("--before", type=Path, help="JSON next to the page of earlier code")
    parser.add_argument("-o", "--output", type=Path, help="page, by default docs/why_RUN.md")
    options = parser.parse_args()
    options.output = options.output or ROOT / "docs" / f"why_{options.run}.md"
    return options


def _wanted(wrong: Sequence[Case], options: argparse.Namespace) -> list[Case]:
    """Wrong verdicts to be explained now, the quickest first."""
    some = sorted(wrong, key=lambda case: sum(case["seconds"].values()))
    if options.only:
        numbers = {int(number) for number in options.only.split(",")}
        if unknown := numbers - {case["index"] for case in wrong}:
            sys.exit(f"no wrong verdict in {sorted(unknown)}: see docs/wide_{options.run}.md")
        some = [case for case in some if case["index"] in numbers]
    some = some[: options.studies]
    return some if options.part is None else some[options.part :: _PARTS]


def _published(file: Path) -> dict[int, Case]:
    """The studies on a page, each with the commit of the code that explained it."""
    if not file.exists():
        return {}
    known = json.loads(file.read_text(encoding="utf-8"))
    return {case["index"]: {"commit": known["commit"], **case} for case in known["cases"]}


def _publish(options: argparse.Namespace, found: Sequence[Case], wrong: int) -> None:
    before = json.loads(options.before.read_text(encoding="utf-8")) if options.before else None
    command = shlex.join([".venv/bin/python", "validation/why.py", *sys.argv[1:]])
    origin = Origin.now(command, ROOT)
    page = why_page(options.run, found, wrong, origin, before)
    write_whole(options.output, page.encode())
    result = {"schema": 1, "run": options.run, "commit": origin.commit, "cases": list(found)}
    write_json(options.output.with_suffix(".json"), result)
    print(options.output)


def explained(run: str, population: Population, case: Case) -> Case:
    """A study with its verdict by the present code and, if that is wrong, the cause."""
    begun = time.perf_counter()
    found: dict[str, Any] = {"plan": run, "index": case["index"], "kind": case["kind"]}
    found |= {"names": case["names"], "strata": case["strata"]}
    study = make_study(population, case["index"])
    if not math.isclose(study.peak, case["peak_N"], rel_tol=1e-6):
        sys.exit(f"study {case['index']} is not what it was: the simulator has changed")
    try:
        diagnosis = diagnose(prepare(study.pad), Choices(), settings=THRESHOLDS)
        now = case | verdict_of(diagnosis.result)
        found |= {key: now[key] for key in ("verdict", "effects", "group", "refused")}
        found |= {"cause": RIGHT} if is_right(now) else caused(study, diagnosis, now)
    except Exception as error:  # one bad study must not end a run of many
        found |= {"cause": "failed", "error": f"{type(error).__name__}: {error}"}
    return found | {"seconds": time.perf_counter() - begun}


def caused(study: BlindStudy, diagnosis: Diagnosis, case: Case) -> Case:
    """Return the cause and what it rests on."""
    experiment, search = diagnosis.work.experiment, diagnosis.work.search
    answer = diagnosis.work.selected.hypothesis
    said, said_log = _best(search, answer)
    rig = Rig.of(study, experiment)
    every = truths(study.law, study.effects, rig)
    tried = [one for one in every if one.hypothesis.effects <= set(search.density.space.effects)]
    outsider = case["kind"] in _OUTSIDE
    misled = case["verdict"] in _NOTHING_ELSE or names_wrongly(case)
    found: Case = {"answer": described(answer), "log_answer": said_log, "exact": every[0].exact}
    if not tried:
        compared = Compared(None, -math.inf, said_log, False, False, outsider, misled)
        return found | {"cause": compared.cause, "truth": described(every[0].hypothesis)}
    fits = {one.hypothesis: from_truth(search.density, one) for one in tried}
    reached = {h: _best(search, h, modes) for h, modes in fits.items()}
    best = max(tried, key=lambda one: reached[one.hypothesis][1])
    mode, log = reached[best.hypothesis]
    true = {_by_family(search, h) for h in fits}
    alike = [h for h in search.modes if _by_family(search, h) in true]
    seen = max([_best(search, h)[1] for h in alike], default=-math.inf)
    record = search.density.space.record
    sound = adequacy(experiment, record, mode.point, search.settings.cells)
    same = answer in alike
    is_sound = sound.is_sound(search.settings)
    log = max(log, seen)
    compared = Compared(log, seen, said_log, is_sound, same, outsider, misled)
    return found | {
        "cause": compared.cause, "truth": described(best.hypothesis), "log_truth": log,
        "log_seen": seen if math.isfinite(seen) else None, "p_value": sound.p_value, "same": same,
        "likeliest": described(search.best),
        "fit": _figures(search.density, mode.point), "said": _figures(search.density, said.point),
        "true_constants": _at_truth(study, search.density, best),
        "readings": readings(experiment, search.density, mode, None if same else said),
    }  # fmt: skip


def from_truth(density: Density, truth: Truth) -> list[Mode]:
    """Modes from true constants, from some with the relaxation drawn anew, and from near by."""
    theta = truth.theta(density.space.parameters(truth.hypothesis))
    starts = around(density.space, truth.hypothesis, theta, redrawn=_REDRAWN, moved=_MOVED)
    found: list[Mode] = []
    for one in starts:
        found += find_modes(density, truth.hypothesis, one, known=found)
    return distinct(found)


def _by_family(search: Search, hypothesis: Hypothesis) -> tuple[Any, ...]:
    """Its laws, and its effects by the listed name of each: a form of what is there is true too."""
    return hypothesis.base, frozenset(
        search.families.family_of[name] for name in hypothesis.effects
    )


def _best(search: Search, hypothesis: Hypothesis, more: Sequence[Mode] = ()) -> tuple[Mode, float]:
    """The likeliest of the search's modes and of more, with its log posterior by Laplace."""
    modes = [one.mode for one in search.modes.get(hypothesis, [])] + list(more)
    tolerance = search.settings.tolerance
    logs = [candidate_at(search.density, hypothesis, m, tolerance).log_evidence for m in modes]
    k = int(np.argmax(logs))
    return modes[k], logs[k] + search.log_prior(hypothesis)


def _figures(density: Density, point: Point) -> dict[str, float]:
    """Loss at the likeliest size of a discrepancy, that size (N), chi^2 a reading under noise."""
    size = density.likeliest_size(point)
    chi2 = float(np.mean(point.residual**2))
    return {"loss": float(density.terms(point, size).loss), "size_N": size, "chi2": chi2}


def _at_truth(study: BlindStudy, density: Density, truth: Truth) -> dict[str, float] | None:
    """Figures at the true constants; of chi^2 what the noise makes, and what the model does."""
    theta = truth.theta(density.space.parameters(truth.hypothesis))
    point = density.at(truth.hypothesis, theta)
    if point is None:
        return None
    true = _true_means(study, density)
    observed = np.asarray(density.space.record.blocks.force)
    parts = density.whitener(np.stack([observed - true, true - point.predicted]))
    noise, model = np.mean(parts**2, axis=1).tolist()
    return _figures(density, point) | {"chi2_noise": noise, "chi2_model": model}


def _true_means(study: BlindStudy, density: Density) -> Array:
    """(T, B) block means of the simulator's forces without noise (N); 0 where there is no block."""
    blocks = density.space.record.blocks
    real, first, last = (np.asarray(x) for x in (blocks.real, blocks.first, blocks.last))
    found = np.zeros(real.shape)
    forces = study.forces(study.law, study.effects, study.times)
    for k, (test, force) in enumerate(zip(study.pad.tests, forces, strict=True)):
        total = np.concatenate([[0.0], np.cumsum(force)])
        begin = np.searchsorted(test.time, first[k][real[k]], side="left")
        end = np.searchsorted(test.time, last[k][real[k]], side="right")
        found[k, real[k]] = (total[end] - total[begin]) / (end - begin)
    return found


def readings(
    experiment: Experiment, density: Density, mode: Mode, other: Mode | None
) -> dict[str, Any]:
    """Find the block means that speak against a mode, compared with another or with noise alone."""
    real, blocks = density.space.real, density.space.record.blocks
    left = (np.asarray(blocks.force) - mode.point.predicted)[real]
    free, root = one_by_one(_precision(density, mode.size if other else 0.0), left)
    parts = 0.5 * (free**2 - 1.0)
    if other is not None:
        others = (np.asarray(blocks.force) - other.point.predicted)[real]
        compared, scale = one_by_one(_precision(density, other.size), others)
        parts = scale - 0.5 * compared**2 - (root - 0.5 * free**2)
    half = carrying_half(parts)
    tests = np.broadcast_to(np.arange(len(real))[:, None], real.shape)[real]
    middle = 0.5 * (np.asarray(blocks.first) + np.asarray(blocks.last))[real]
    largest = [
        {
            "test": experiment.trials[tests[k]].name,
            "phase": str(experiment.trials[tests[k]].phase_of(middle[[k]])[0]),
            "time_s": float(middle[k]), "nats": float(parts[k]), "residual_N": float(left[k]),
        }
        for k in half[:_SHOWN]
    ]  # fmt: skip
    return {"nats": float(parts.sum()), "half": len(half), "of": parts.size, "largest": largest}


def _precision(density: Density, size: float) -> Array:
    """(n, n) of all block means (1/N^2), under noise and a discrepancy of a size (N)."""
    return density.discrepancy.at(size).products(density.whitener.matrix.T)


if __name__ == "__main__":
    main()
