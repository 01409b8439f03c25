"""Blind studies of lifelike pads: simulate and diagnose them, keep each, count the verdicts.

`lifelike.py --studies N --seed S --jobs J -o OUT` writes OUT/lifelike.jsonl, a study a line, from
which an interrupted run goes on, and OUT/lifelike.json with the counts; with `--first K` only the
first K studies are run and counted. `--write INDEX -o FILE.csv` writes the record of one study, and
its truth beside it as JSON. `lifelike_pads` says what is hidden, `lifelike_sizes` when it can be
seen.
"""

from __future__ import annotations

import argparse
import math
import os
import platform
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial
from itertools import pairwise
from pathlib import Path

from blind.case import FAILED, THRESHOLDS, verdict_of
from blind.counting import (
    Case,
    Rate,
    bound,
    has_failed,
    is_named,
    names_wrongly,
    true_names,
)
from blind.population import kin
from blind.store import Store, run_missing
from lifelike_pads import Lifelike, make_study
from lifelike_sizes import SEEN
from results import Origin, Table, commits_of, share

from qlvbayes.cli.console import counting
from qlvbayes.diagnosis.diagnose import diagnose
from qlvbayes.diagnosis.result import DiagnosisResult
from qlvbayes.io.files import write_json
from qlvbayes.model.choices import Choices
from qlvbayes.motion.experiment import prepare
from qlvbayes.parallel.engines import opened_engine
from qlvbayes.simulate import Record, SimulatedTest, write_csv

ROOT = Path(__file__).resolve().parents[1]
_EDGES = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)  # of ranges of certainty
LEAST = 0.02  # probability of an effect that is stored with its evidence


def run_case(seed: int, commit: str, index: int) -> Case:
    """Simulate one study and diagnose it; an error of the diagnosis is its verdict."""
    begun = time.process_time()
    study = make_study(seed, index)
    case: Case = {"plan": plan_key(seed), "index": index, "seed": seed, "commit": commit}
    case |= truth_of(study)
    between = time.process_time()
    try:
        result = diagnose(prepare(study.pad), Choices(), settings=THRESHOLDS).result
        case |= verdict_of(result) | {"ranking": _ranking(result)}
    except Exception as error:  # one bad study must not end a run of hundreds
        text = f"{type(error).__name__}: {error}"
        case |= {"verdict": FAILED, "error": text, "effects": [], "group": []}
    case["seconds"] = {"simulate": between - begun, "diagnose": time.process_time() - between}
    return case


def plan_key(seed: int) -> str:
    """Return the name of the studies of one seed."""
    return f"lifelike-seed{seed}"


def truth_of(study: Lifelike) -> Case:
    """Return what is hidden in a study and how it was measured, as plain values."""
    names, rig = study.item.names, study.rig
    hidden = [
        {
            "name": name, "form": effect.name, "parameters": effect.parameters,
            "strength": type(effect).recipe.size, "factors": list(factors), "spread": spread,
            "seen": study.seen[name], "left": dict(zip(_PARTS, study.left[name], strict=True)),
        }
        for name, effect, factors, spread in zip(
            names, study.effects, study.strengths, study.spreads[:-1], strict=True
        )
    ]  # fmt: skip
    law = study.law
    return {
        "kind": study.item.kind, "scene": study.item.scene, "names": list(names),
        "kin": {name: sorted(kin(name)) for name in names},
        "strata": {
            "programme": rig.plan.kind, "elastic": law.elastic, "relaxation": law.relaxation,
            "logger": rig.logger,
        },
        "hidden": hidden,
        "seen": all(value >= SEEN for value in study.seen.values()),
        "unlisted": {
            "kind": study.unlisted.name, "parameters": study.unlisted.parameters,
            "share_of_peak": study.unlisted_share,
        },
        "stiffness": {"factors": list(study.stiffness), "spread": study.spreads[-1]},
        "law": asdict(law), "cell": asdict(study.cell), "peak_N": study.peak,
        # the rules of the count allow a contact offset where there is a gap
        "rig": {
            "gap_mm": abs(rig.contact), "contact_mm": rig.contact, "width_mm": rig.width,
            "jerk_mm_s3": rig.plan.jerk, "ramp_s": rig.plan.ramp, "lead_mm": rig.plan.lead,
        },
        "tests": list(rig.motions), "rows": [int(t.size) for t in rig.times],
    }  # fmt: skip


_PARTS = ("effect", "unlisted", "noise")  # root mean squares over the peak


def _ranking(result: DiagnosisResult) -> list[dict]:
    support = {one.effect: one.support for one in result.ranking if one.support is not None}
    return [
        {
            "effect": one.effect, "probability": one.inclusion,
            "log_bayes_factor": one.log_bayes_factor, "certainty": one.certainty,
            "rmse": one.rmse, "parameters": {k: [e.mean, e.sd] for k, e in one.parameters.items()},
            "supported": one.effect in support,
        }
        for one in result.ranking
        if one.inclusion > LEAST
    ]  # fmt: skip


def names_all(case: Case) -> bool:
    """Return whether every hidden effect is named, alone or with further names."""
    sure = case["verdict"] in ("missing_effect", "partly_explained")
    return sure and set(case["names"]) <= set(case["effects"])


def wrong_names(case: Case) -> set[str]:
    """Return the names that are not hidden, where the verdict names any without a rival."""
    return set(case["effects"]) - true_names(case) if names_wrongly(case) else set()


def names_nothing(case: Case) -> bool:
    """Return whether the pad is called adequate, or no effect is named."""
    return is_named(case) or (not case["effects"] and not has_failed(case))


COUNTS: tuple[tuple[str, tuple[str, ...], Callable[[Case], bool], bool], ...] = (
    ("nothing hidden: adequate", ("none",), is_named, True),
    ("nothing hidden: adequate or no name", ("none",), names_nothing, True),
    ("one effect: named, with further names or without", ("single",), names_all, True),
    ("one effect: named alone", ("single",), is_named, True),
    ("two effects: both named", ("double",), names_all, True),
    ("all: a name that is not hidden", ("none", "single", "double"), names_wrongly, False),
    ("all: the program stopped", ("none", "single", "double"), has_failed, False),
)
"""Questions, the kinds of studies that they are asked of, and whether more is better."""


def report(cases: Sequence[Case]) -> dict:
    """Return the counts over the studies that can be seen, with one-sided 95 % bounds."""
    seen = [case for case in cases if case["seen"]]
    rates = {}
    for words, kinds, hit, good in COUNTS:
        rate = Rate.from_cases([case for case in seen if case["kind"] in kinds], hit)
        limit = bound(rate, good) if rate.n else None
        rates[words] = {"hits": rate.hits, "n": rate.n, "share": rate.share, "bound95": limit}
    scenes = {
        scene: dict(Counter(case["verdict"] for case in seen if case["scene"] == scene))
        for scene in sorted({case["scene"] for case in seen})
    }
    wrong = Counter(name for case in seen for name in wrong_names(case))
    return {
        "studies": len(cases), "seen": len(seen), "rates": rates, "verdicts": scenes,
        "wrong_names": dict(wrong), "wrong_names_a_study": sum(wrong.values()) / max(len(seen), 1),
        "cpu_s": sum(sum(case["seconds"].values()) for case in cases),
    }  # fmt: skip


def _print(found: dict) -> None:
    print(f"{found['studies']} studies, {found['seen']} can be seen, {found['cpu_s']:.0f} s of CPU")
    for words, rate in found["rates"].items():
        limit = "-" if rate["bound95"] is None else f"{rate['bound95']:.0%}"
        print(f"  {words}: {rate['hits']} of {rate['n']}, 95 % bound {limit}")
    for scene, verdicts in found["verdicts"].items():
        print(f"  {scene}: {', '.join(f'{n} {verdict}' for verdict, n in verdicts.items())}")
    each = ", ".join(f"{n} {name}" for name, n in found["wrong_names"].items()) or "none"
    print(f"  wrong names: {each}; {found['wrong_names_a_study']:.3f} a study")


def keep(store: Store, seed: int, count: int) -> None:
    """Write validation/results/lifelike.json: the counts up to the first unfinished study."""
    whole = store.missing(count)
    cases = store.first(min(whole, default=count))
    found = report(cases)
    rows = [
        [words, share(rate["hits"], rate["n"]), "-" if limit is None else f"{limit:.0%}"]
        for words, rate in found["rates"].items()
        for limit in [rate["bound95"]]
    ]
    each = ", ".join(f"{n} {name}" for name, n in found["wrong_names"].items()) or "none"
    note = (
        f"{len(cases)} of {count} registered studies were finished, {found['seen']} can be seen; "
        f"{found['cpu_s'] / max(len(cases), 1):.0f} s of CPU a study; wrong names: {each}."
    )
    notes = [note, _calibration(cases), _by_size(cases)]
    machine = f"{os.cpu_count()} cores ({platform.machine()}), Python {platform.python_version()}"
    command = f"python validation/lifelike.py --studies {count} --seed {seed}"
    origin = Origin(command, Origin.today(), commits_of(cases), machine)
    Table(origin, len(cases), ["hidden: verdict", "studies", "bound"], rows, notes).write(
        "lifelike"
    )


_SIZES = (SEEN, 5.0, 8.0, math.inf)  # times what hides an effect
_SPREADS = (0.0, 0.02, 0.05, math.inf)  # of the stiffness between tests


def _by_size(cases: Sequence[Case]) -> str:
    """Return how many hidden effects are named, by their size and by the pads' scatter."""
    hidden = [
        (one["seen"], case["stiffness"]["spread"], bool(kin(one["name"]) & set(case["effects"])))
        for case in cases
        if case["seen"]
        for one in case["hidden"]
    ]
    by_size = _shares([(size, named) for size, _, named in hidden], _SIZES)
    by_spread = _shares([(spread, named) for _, spread, named in hidden], _SPREADS)
    return (
        f"Hidden effects that are named, by their size over what hides them: {by_size}; by the "
        f"scatter of the stiffness from test to test: {by_spread}."
    )


def _shares(valued: Sequence[tuple[float, bool]], edges: Sequence[float]) -> str:
    words = []
    for low, high in pairwise(edges):
        hits = [hit for value, hit in valued if low <= value < high]
        ends = f"{low:g} to {high:g}" if math.isfinite(high) else f"{low:g} and more"
        words.append(f"{ends}: {share(sum(hits), len(hits))}")
    return ", ".join(words)


def _calibration(cases: Sequence[Case]) -> str:
    """Return how many effects of each range of certainty are there, in studies that can be seen."""
    stated = [
        (one["certainty"], one["effect"] in true_names(case))
        for case in cases
        if case["seen"]
        for one in case.get("ranking", ())
        if one["certainty"] is not None
    ]
    words = []
    for low, high in pairwise(_EDGES):
        there = [own for sure, own in stated if low <= sure < high or sure == high == 1.0]
        words.append(f"{low:g} to {high:g}: {share(sum(there), len(there))}")
    return f"Effects that are there, by their certainty: {'; '.join(words)}."


def write(seed: int, index: int, output: Path) -> None:
    """Write one study's record and, beside it, its truth."""
    study = make_study(seed, index)
    truth, rig = study.forces(), study.rig
    tests = []
    for test, motion, force in zip(study.pad.tests, rig.motions.values(), truth, strict=True):
        true = motion.displacement(test.time)
        record = Record(test.time, test.displacement, test.force, true, force)
        tests.append(SimulatedTest("pad", test.name, test.start_s or 0.0, record))
    write_csv(output, tests, [f"simulated, not measured: lifelike study {index} of seed {seed}"])
    write_json(output.with_name(f"{output.name.split('.')[0]}.truth.json"), truth_of(study))


def commit() -> str:
    """Return the commit of the code, with ``-dirty`` where files differ from it."""
    command = ("git", "describe", "--always", "--dirty", "--abbrev=12")
    found = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    return found.stdout.strip() or "unknown"


def main() -> int:
    """Run, count or write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--studies", type=int, default=80)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1, help="processes that run the studies")
    parser.add_argument("--first", type=int, help="run and count only the first of them")
    parser.add_argument("--write", type=int, metavar="INDEX", help="write one study's record")
    parser.add_argument("--keep", action="store_true", help="keep the table of what is finished")
    parser.add_argument("-o", "--output", type=Path, required=True)
    options = parser.parse_args()
    if options.write is not None:
        write(options.seed, options.write, options.output)
        return 0
    count = options.studies if options.first is None else min(options.first, options.studies)
    store = Store(options.output / "lifelike.jsonl", plan_key(options.seed))
    if options.keep:
        keep(store, options.seed, count)
        return 0
    with opened_engine(options.jobs) as engine, counting("studies") as done:
        case = partial(run_case, options.seed, commit())
        run_missing(case, store, range(count), done, engine)
    found = report(store.first(count))
    write_json(options.output / "lifelike.json", found)
    _print(found)
    return 0


if __name__ == "__main__":
    sys.exit(main())
