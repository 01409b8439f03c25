"""Read what is known about a pad before its next test, from its saved fit or diagnosis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from msgspec.structs import replace as with_fields

from qlvbayes.diagnosis.nexttest.belief import Belief, Explanation
from qlvbayes.diagnosis.nexttest.design import Design, Rig
from qlvbayes.diagnosis.nexttest.explanations import explanation_of_draws, explanation_of_mode
from qlvbayes.diagnosis.nexttest.records import ReadingErrors, record_of
from qlvbayes.diagnosis.nexttest.suggest import cause_of
from qlvbayes.diagnosis.prior import Families
from qlvbayes.diagnosis.result import Alternative, DiagnosisResult
from qlvbayes.diagnosis.search import Search
from qlvbayes.diagnosis.searchsetup import as_chosen, build_search
from qlvbayes.effects.catalogue import EFFECTS, FORMS, OUTSIDE
from qlvbayes.fitting.results import Run, RunLog, Saved, load
from qlvbayes.inference.forward.hypothesis import Hypothesis
from qlvbayes.io.checks import InputError
from qlvbayes.io.data import read_measurements
from qlvbayes.io.units import UnitSystem
from qlvbayes.model.choices import Choices
from qlvbayes.motion.noisefloor import NoiseFloor

CAUSE = "cause"
MOST_CAUSES = 4
"""Most causes that a plan distinguishes."""
LEAST_PROBABILITY = 0.05
"""Probability from which a cause, or a further explanation of one, counts."""
MOST_EXPLANATIONS = 6
"""Most explanations of all causes together: each costs a simulation of every design."""


@dataclass(frozen=True, eq=False)
class Knowledge:
    """Knowledge about a pad before its next test."""

    pad: str
    units: UnitSystem
    # explanations of the tests so far, with probabilities and draws of their constants
    belief: Belief
    rig: Rig  # limits of the rig as these tests show them
    floor: NoiseFloor  # noise of the load cell
    discrepancy: float  # size of what no effect explains (force)
    clock: float = 0.0  # time on the pad's clock after these tests (s)

    def errors(self, rig: Rig) -> ReadingErrors:
        """Return the reading errors of tests on a rig."""
        press = Design(rig.depth, rig.speed, rig.acceleration, 1.0)
        first = self.belief.explanations[0]
        force = first.forces(np.zeros((1, first.size)), record_of([press], rig, self.clock))
        return ReadingErrors(self.floor, float(np.max(np.abs(force))), self.discrepancy)


def read_knowledge(
    folder: Path, out: Path, goals: Sequence[str], data: Path | None
) -> tuple[Knowledge, bool]:
    """Return what is known, and whether the plan shall distinguish causes."""
    fit, diagnosis = folder / "posterior.nc", folder / "diagnosis.json"
    result = DiagnosisResult.read(diagnosis) if diagnosis.is_file() else None
    if result is None and not fit.is_file():
        raise InputError(
            "neither a fit nor a diagnosis of this pad", file=folder, remedy="run qlvbayes fit"
        )
    families = Families.from_kinds((*EFFECTS, *FORMS, *OUTSIDE))
    probable = probable_alternatives(result.alternatives, families) if result else []
    causes = {cause_of(one.effects, families) for one in probable}
    wanted = CAUSE in goals
    if wanted and len(causes) < 2:
        raise InputError(
            "no two sets of effects are in doubt" if result else "no diagnosis of this pad",
            file=folder,
            remedy="ask for constants, as --for m,b" if result else "run qlvbayes diagnose",
        )
    cause = wanted or (not goals and len(causes) > 1)
    if not cause and fit.is_file():
        return knowledge_from_fit(load(fit), data), False
    assert result is not None
    return _knowledge_from_diagnosis(out, result, probable, data), cause


def probable_alternatives(
    alternatives: Sequence[Alternative], families: Families
) -> list[Alternative]:
    """Return the explanations that count, with probabilities, the most probable first."""
    groups: dict[str, list[Alternative]] = {}
    for one in sorted(alternatives, key=lambda one: -one.probability):
        groups.setdefault(cause_of(one.effects, families), []).append(one)
    total = {cause: sum(one.probability for one in some) for cause, some in groups.items()}
    counted = sorted(
        (cause for cause in groups if total[cause] >= LEAST_PROBABILITY), key=lambda c: -total[c]
    )
    counted = counted[:MOST_CAUSES]
    firsts = [groups[cause][0] for cause in counted]
    others = [
        one
        for cause in counted
        for one in groups[cause][1:]
        if one.probability >= LEAST_PROBABILITY
    ]
    others.sort(key=lambda one: -one.probability)
    kept = [*firsts, *others][:MOST_EXPLANATIONS]
    shared = []
    for cause in counted:
        own = [one for one in kept if one in groups[cause]]
        factor = total[cause] / sum(one.probability for one in own)
        shared += [with_fields(one, probability=factor * one.probability) for one in own]
    return sorted(shared, key=lambda one: -one.probability)


def knowledge_from_fit(saved: Saved, data: Path | None = None) -> Knowledge:
    """Return what is known by a fit's posterior, and of the rig by its measurements if given."""
    if saved.covered is None:
        raise InputError(
            f"the posterior of pad {saved.pad} does not say what its tests cover",
            remedy="run qlvbayes fit again",
        )
    draws = dict(zip(saved.names, saved.draws.T, strict=True))
    one = explanation_of_draws(saved.choices, saved.names, saved.draws, saved.covered.depth)
    knowledge = Knowledge(
        saved.pad,
        saved.units,
        Belief.from_explanations([one]),
        Rig.from_ranges(saved.covered),
        _floor_of(draws, saved.pad),
        float(np.median(draws.get("noise.remainder", np.zeros(1)))),
    )
    source = data or Path(saved.source)
    if data is None and not source.is_file():
        return knowledge
    study = read_measurements(source)
    if study.sha256 != saved.sha256:
        raise InputError(
            "not the measurements that were fitted", file=source, remedy="run qlvbayes fit again"
        )
    experiment = saved.choices.prepare(study.pad(saved.pad))
    return replace(knowledge, rig=Rig.from_tests(experiment), clock=experiment.scales.clock)


def _floor_of(draws: dict[str, np.ndarray], pad: str) -> NoiseFloor:
    """Return the noise floor at the means of its draws."""
    mean = {name: float(values.mean()) for name, values in draws.items()}
    factor = mean.get("noise.factor", 1.0)
    white = mean.get("noise.white", mean.get("noise.scale"))
    if white is None:
        raise InputError(
            f"the posterior of pad {pad} has no noise", remedy="give draws of noise.white"
        )
    return NoiseFloor(
        factor * white, factor * mean.get("noise.ou", 0.0), mean.get("noise.tau", 1.0)
    )


def _knowledge_from_diagnosis(
    out: Path, result: DiagnosisResult, probable: Sequence[Alternative], data: Path | None
) -> Knowledge:
    run = _run(out)
    source, sha256 = Path(run.source), run.sha256
    if not sha256:  # of several files, of which the pad's fit names its own
        fits = [out / result.pad / within / "posterior.nc" for within in ("plain", "")]
        saved = next((load(fit) for fit in fits if fit.is_file()), None)
        source, sha256 = (Path(saved.source), saved.sha256) if saved else (source, "")
    source = data or source
    if not source.is_file():
        raise InputError(
            "the measurements that were diagnosed are not there",
            file=source,
            remedy="say where they are with --data FILE",
        )
    study = read_measurements(source)
    if sha256 and study.sha256 != sha256:
        raise InputError(
            "not the measurements that were diagnosed",
            file=source,
            remedy="run qlvbayes diagnose again",
        )
    choices = Choices.from_dict(run.choices)
    experiment = as_chosen(choices.prepare(study.pad(result.pad)), choices)
    thresholds = result.settings.thresholds if result.settings else None
    search = build_search(experiment, choices, kinds=choices.candidates, settings=thresholds)
    explanations = explanations_at_modes(search, probable or result.alternatives[:1])
    scales = experiment.scales
    return Knowledge(
        result.pad,
        experiment.units,
        Belief.from_explanations(explanations, result.outside),
        Rig.from_tests(experiment),
        experiment.floor,
        result.discrepancy,
        scales.clock,
    )


def _run(out: Path) -> Run:
    """Return the last run that diagnosed."""
    path = out / "run.json"
    runs = RunLog.read(path).runs if path.is_file() else {}
    run = runs.get("diagnose", runs.get("study"))
    if run is None:
        raise InputError("no diagnosis in this folder", file=out, remedy="run qlvbayes diagnose")
    return run


def explanations_at_modes(search: Search, alternatives: Sequence[Alternative]) -> list[Explanation]:
    """Return the alternatives at their most probable modes; those without a mode are left out."""
    search.begin()
    explanations = []
    for one in alternatives:
        base = Hypothesis(*one.base.pair, search.baseline.effects)
        hypothesis = replace(base, effects=base.effects | set(one.effects))
        search.evaluate(base)
        if base in search.modes:
            search.evaluate(hypothesis, base)
        if hypothesis in search.modes:
            best, cause = search.modes[hypothesis][0], cause_of(one.effects, search.families)
            explanations.append(explanation_of_mode(search.density, best, one.probability, cause))
    if not explanations:
        raise InputError(
            "none of the diagnosis's explanations fits any more",
            remedy="run qlvbayes diagnose again",
        )
    return explanations
