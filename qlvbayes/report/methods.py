"""State how it was done, so that it can be judged and done again."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from qlvbayes.fitting.summary import FitSummary
from qlvbayes.io.checks import InputError
from qlvbayes.io.escaping import as_typed
from qlvbayes.io.wording import DASH, number, percent_unbroken, with_unit
from qlvbayes.laws.catalogue import find_elastic, find_relaxation
from qlvbayes.model.choices import Choices
from qlvbayes.model.noise import NOISES
from qlvbayes.report.collect import PadResults, Results

_THRESHOLDS = {
    "complete": "the prior probability that no (further) effect is missing is {}",
    "chosen_law": "that the elastic law is the one chosen it is {}, as for the relaxation",
    "candidate": "a candidate effect has {} of its family's prior probability",
    "named": "an effect is named when it is in the model with probability {} over all hypotheses",
    "confirmed": "no effect is named whose certainty by blind studies is below {}",
    "covered": "a group holds the effect with probability {}",
    "tolerance": "effects and systematic errors below {:.2g} of the peak force do not matter",
    "false_alarms": "a right model is found to fail with probability {}",
    "breadth": "hypotheses are looked for with {}",
    "discrepancy": "the prior of what else may be missing has {}",
    "narrowest": "the prior of an effect's size is fitted to the motion within factors of {}",
    "widest": "and {}",
    "group": "a group has at most {} effects",
    "unlisted": "something outside the list is taken to be there from a probability of {} on",
    "returned": "a test has retracted where it is below {:.2g} of the depth or the peak force",
    "cells": "systematic errors are looked for with {}",
    "imitation": "strengths in single tests are compared with {}",
    "scatter": "stiffness and strengths may differ from test to test, with {}",
    "measured": "an effect that the readings show beyond doubt has the certainty {}",
    "own": "no effect is named whose probability over all hypotheses is below {}",
}


@dataclass(frozen=True)
class Basis:
    """Data, sampler and priors on which one pad's constants rest."""

    pad: str
    fitted: str
    sampler: str
    noise: str
    priors: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Methods:
    """Model, inference and provenance of the results."""

    law: str
    relaxation: str
    contact: str
    noise: str
    effects: tuple[str, ...]
    thresholds: tuple[str, ...]
    comparisons: str
    bases: tuple[Basis, ...]
    sources: tuple[tuple[str, str], ...]
    seeds: str
    versions: tuple[tuple[str, str], ...]
    commands: tuple[str, ...]


def methods_of(results: Results) -> Methods:
    """Return what lies in ``posterior.nc`` and ``run.json``, as far as they are there."""
    choices = _choices(results)
    runs = list(results.runs.values())
    return Methods(
        *_laws(choices),
        "bonded: the specimen can pull"
        if choices.get("bonded")
        else "loose: the pad cannot pull, so that its force is never negative",
        NOISES[noise].words if (noise := str(choices.get("noise", DASH))) in NOISES else noise,
        tuple(sorted({e for pad in results.pads for e in pad.final.effects})),
        _thresholds(results),
        _comparisons(results),
        tuple(_basis(pad) for pad in results.pads),
        tuple(sorted(_sources(results))),
        ", ".join(sorted({str(seed) for seed in _seeds(results)})) or DASH,
        tuple(_versions(results).items()),
        tuple(run.command for run in runs) or _commands(results),
    )


def _laws(choices: dict) -> tuple[str, str]:
    """Return both laws as equations; by name where a file of the user's own has gone."""
    if not {"elastic", "law"} & choices.keys():
        return DASH, DASH
    try:
        given = Choices.from_dict(choices)
        elastic = find_elastic(given.elastic, given.laws)
        relaxation = find_relaxation(given.relaxation, given.laws)
    except InputError:
        name = str(choices.get("elastic", choices.get("law", DASH)))
        return name, str(choices.get("relaxation", DASH))
    modes = f", of {given.modes} mode{'s' if given.modes != 1 else ''}"
    return elastic.law, relaxation.law + modes * given.is_prony


def _thresholds(results: Results) -> tuple[str, ...]:
    """Return the thresholds of the first diagnosis in words, the others by name."""
    recorded = (pad.diagnosis.settings for pad in results.pads if pad.diagnosis)
    used = next((settings for settings in recorded if settings), None)
    known = asdict(used.thresholds) if used else {}
    known = {name: _counted(own) if isinstance(own, dict) else own for name, own in known.items()}
    return tuple(
        _THRESHOLDS.get(name, f"{name} = {{}}").format(value) for name, value in known.items()
    )


def _counted(fields: dict[str, Any]) -> str:
    """Return named values as ``beam = 2, near = 25``, and groups of them in parentheses."""
    return ", ".join(
        f"{name} ({_counted(value)})" if isinstance(value, dict) else f"{name} = {value:g}"
        for name, value in fields.items()
    )


def _comparisons(results: Results) -> str:
    """Return how pads were compared, from what the first comparison says of itself."""
    if not results.comparisons:
        return ""
    comparison = results.comparisons[0].comparison
    text = (
        "the posterior draws of two pads are independent and are paired at random; quantities are "
        f"equal where their ratio is within {percent_unbroken(comparison.region)} of one with a "
        f"probability of at least {percent_unbroken(0.95)}"
    )
    if comparison.omnibus is None:
        return f"{text}."
    joint = "whether they differ at all is a joint test that equals fail in"
    return f"{text}; {joint} {percent_unbroken(comparison.omnibus.false_alarms)} of cases."


def source_name(results: Results) -> str | None:
    """Return the measurements' file name, if all pads come from one."""
    names = {name for name, _ in _sources(results)}
    return names.pop() if len(names) == 1 else None


def _choices(results: Results) -> dict:
    for pad in results.pads:
        if "choices" in pad.final.facts:
            return json.loads(pad.final.facts["choices"])
    return next((run.choices for run in results.runs.values()), {})


def _sources(results: Results) -> set[tuple[str, str]]:
    facts = [pad.final.facts for pad in results.pads]
    sources = [(f["source"], str(f.get("sha256", ""))) for f in facts if f.get("source")]
    sources += [(run.source, run.sha256) for run in results.runs.values()]
    return {(Path(source).name, digest) for source, digest in sources}


def _seeds(results: Results) -> set[int]:
    facts = [pad.final.facts for pad in results.pads]
    seeds = {int(f["seed"]) for f in facts if "seed" in f}
    return seeds | {run.seed for run in results.runs.values()}


def _versions(results: Results) -> dict[str, str]:
    versions: dict[str, str] = {}
    for pad in results.pads:
        if "qlvbayes_version" in pad.final.facts:
            versions["qlvbayes"] = str(pad.final.facts["qlvbayes_version"])
    for run in results.runs.values():
        versions |= run.versions
    return versions


def _commands(results: Results) -> tuple[str, ...]:
    """Return commands, where none was noted the one that fits with the same choices."""
    name = source_name(results)
    if name is None:
        return ()
    default = Choices()
    given = Choices.from_dict(_choices(results)) if _choices(results) else default
    words = ["qlvbayes", "fit", name, "-o", results.out.name]
    options = {"elastic": "elastic", "relaxation": "relaxing", "noise": "noise"}
    for option, key in options.items():
        if getattr(given, key) != getattr(default, key):
            words += [f"--{option}", str(getattr(given, key))]
    for option, values in (("prior", given.priors), ("fix", given.fixed), ("add", given.effects)):
        words += [word for value in values for word in (f"--{option}", value)]
    return (as_typed(*words),)


def _basis(pad: PadResults) -> Basis:
    facts, summary = pad.final.facts, pad.final.summary
    checked = pad.final.check or pad.diagnosis
    return Basis(
        pad.name,
        ", ".join(json.loads(facts["fitted_tests"])) if "fitted_tests" in facts else DASH,
        _sampler(facts, summary),
        with_unit(number(checked.noise), pad.force_unit) if checked else DASH,
        tuple(json.loads(facts["priors"]).items()) if "priors" in facts else (),
    )


def _sampler(facts: dict, summary: FitSummary | None) -> str:
    method = str(facts.get("method") or (summary.sampler if summary else DASH))
    if "walkers" not in facts:
        return method
    return (
        f"{method}: {number(facts['walkers'])} walkers, {number(facts['kept_steps'], 6)} of "
        f"{number(facts['steps'], 6)} steps kept, autocorrelation time "
        f"{number(facts['autocorrelation_steps'])} steps, acceptance "
        f"{percent_unbroken(facts['acceptance'])}{_quality(summary)}"
    )


def _quality(summary: FitSummary | None) -> str:
    constants = summary.parameters.values() if summary else ()
    hats = [c.r_hat for c in constants if c.r_hat is not None]
    sizes = [c.ess_bulk for c in constants if c.ess_bulk is not None]
    if not hats or not sizes:
        return ""
    return f"; largest R-hat {max(hats):.3f}, smallest effective sample size {min(sizes):.0f}"
