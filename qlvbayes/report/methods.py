"""State how it was done, so that it can be judged and done again."""

from __future__ import annotations

import json
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, get_type_hints

from qlvbayes.comparison.contrast import DECIDED, EQUAL
from qlvbayes.fitting.summary import FitSummary
from qlvbayes.io.checks import InputError
from qlvbayes.io.wording import DASH, as_typed, number, percent_unbroken, plain, with_unit
from qlvbayes.laws.catalogue import find_elastic, find_relaxation
from qlvbayes.model.choices import Choices
from qlvbayes.model.noise import NOISES
from qlvbayes.report.collect import PadResults, Results


def methods_of(results: Results) -> dict[str, Any]:
    """Return model, inference and provenance, as far as the results' files say them."""
    choices, runs = _choices(results), list(results.runs.values())
    law, relaxation = _laws(choices)
    noise = str(choices.get("noise", DASH))
    bonded, loose = (
        "bonded: the specimen can pull",
        "loose: the pad cannot pull, so that its force is never negative",
    )
    recorded = (pad.diagnosis.settings for pad in results.pads if pad.diagnosis)
    used = next((settings for settings in recorded if settings), None)
    facts = [pad.final.facts for pad in results.pads]
    seeds = {str(int(f["seed"])) for f in facts if "seed" in f} | {str(run.seed) for run in runs}
    return {
        "law": law,
        "relaxation": relaxation,
        "contact": bonded if choices.get("bonded") else loose,
        "noise": NOISES[noise].words if noise in NOISES else noise,
        "effects": sorted({e for pad in results.pads for e in pad.final.effects}),
        "settings": settings_rows(used.thresholds) if used else [],
        "comparisons": _comparisons(results),
        "bases": [_basis(pad) for pad in results.pads],
        "sources": sorted(_sources(results)),
        "seeds": ", ".join(sorted(seeds)) or DASH,
        "versions": list(_versions(results).items()),
        "commands": [run.command for run in runs] or _commands(results),
    }


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


def settings_rows(settings: object) -> list[tuple[str, str]]:
    """Return each setting in words with its value; those of a part stand in its place."""
    assert is_dataclass(settings)
    hints, rows = get_type_hints(type(settings), include_extras=True), []
    for field in fields(settings):
        value = getattr(settings, field.name)
        if is_dataclass(value):
            rows += settings_rows(value)
        else:
            (words,) = hints[field.name].__metadata__
            rows.append((words, f"{value:g}"))
    return rows


def _comparisons(results: Results) -> str:
    """Return how pads were compared, from what the first comparison says of itself."""
    if not results.comparisons:
        return ""
    comparison = results.comparisons[0].comparison
    text = (
        "the posterior draws of two pads are independent and are paired at random; quantities are "
        f"equal where their ratio is within {percent_unbroken(comparison.region)} of one with a "
        f"probability of at least {percent_unbroken(EQUAL)}"
    )
    if comparison.omnibus is None:
        return f"{text}."
    rate = percent_unbroken(comparison.omnibus.false_alarms)
    return (
        f"{text}; otherwise they are different where one is greater with a probability of at least "
        f"{percent_unbroken(DECIDED)}. Whether the pads differ at all is one joint test, which "
        f"calls {rate} of pairs of equal pads different."
    )


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
    words = ["qlvbayes", "fit", name, "-o", results.typed]
    options = {"elastic": "elastic", "relaxation": "relaxing", "noise": "noise"}
    for option, key in options.items():
        if getattr(given, key) != getattr(default, key):
            words += [f"--{option}", str(getattr(given, key))]
    for option, values in (("prior", given.priors), ("fix", given.fixed), ("add", given.effects)):
        words += [word for value in values for word in (f"--{option}", value)]
    return (as_typed(*words),)


def _basis(pad: PadResults) -> dict[str, Any]:
    """Return data, sampler and priors on which one pad's constants rest."""
    facts, noise = pad.final.facts, pad.noise
    return {
        "pad": pad.name,
        "fitted": ", ".join(json.loads(facts["fitted_tests"])) if "fitted_tests" in facts else DASH,
        "noise": DASH if noise is None else with_unit(number(noise), pad.force_unit),
        "sampler": _sampler(facts, pad.final.summary),
        "priors": json.loads(facts.get("priors", "{}")),
    }


def _sampler(facts: dict, summary: FitSummary | None) -> str:
    method = str(facts.get("method") or (summary.sampler if summary else DASH))
    if "walkers" not in facts:
        return method
    constants = list(summary.parameters.values()) if summary else []
    hats = [c.r_hat for c in constants if c.r_hat is not None]
    sizes = [c.ess_bulk for c in constants if c.ess_bulk is not None]
    quality = ""
    if hats and sizes:
        quality = (
            f"; largest R-hat {max(hats):.3f}, smallest effective sample size {min(sizes):.0f}"
        )
    return (
        f"{method}: {number(facts['walkers'])} walkers, {number(facts['kept_steps'], 6)} of "
        f"{number(facts['steps'], 6)} steps kept, autocorrelation time "
        f"{number(facts['autocorrelation_steps'])} steps, acceptance "
        f"{percent_unbroken(facts['acceptance'])}{quality}"
    )


def uses_of(results: Results) -> list[tuple[str, str]]:
    """Return what the first fitted pad can be used for, each with its command."""
    fitted = [pad for pad in results.pads if (pad.folder / "posterior.nc").exists()]
    if not fitted:
        return []
    out, pad = results.typed, fitted[0]
    words = {
        "What a pad does in a motion, or under a load, that no test had, with 90 % bands": (
            "check", "--program", _program(pad),
        ),
        "The pad in a controller, a simulation or finite elements: C, FMU, MuJoCo, Drake, "
        "MATLAB, Abaqus, FEBio, tables, JSON": ("export", "--to", "c,fmu,json"),
        "The most informative next tests, for the constants and for the cause": ("design",),
    }  # fmt: skip
    return [
        (what, as_typed("qlvbayes", command, out, "--pad", pad.name, *more))
        for what, (command, *more) in words.items()
    ]


def _program(pad: PadResults) -> str:
    """Return a press as deep and as fast as the tests went, where that is known."""
    unit = str(pad.final.facts.get("displacement_unit", "mm")).replace("1", "strain")
    try:
        covered = json.loads(pad.final.facts.get("covered", ""))
        depth, speed = float(covered["depth"]), float(covered["fastest"])
    except (ValueError, KeyError, TypeError):
        return f"ramp 1 {unit} in 0.1 s, hold 30 s"
    return f"ramp {plain(depth)} {unit} in {plain(depth / speed)} s, hold 30 s"


def exports_of(results: Results) -> list[tuple[str, Path, list[str]]]:
    """Return pad, folder and files of what was exported already."""
    folders = [
        (pad.name, one) for pad in results.pads for one in sorted(pad.folder.glob("export/*"))
    ]
    return [
        (name, one.relative_to(results.out), sorted(p.name for p in one.iterdir() if p.is_file()))
        for name, one in folders
        if one.is_dir()
    ]
