"""A folder of results written by hand; what does not matter in it is stored in tests/corpus."""

import json
from copy import deepcopy
from dataclasses import asdict
from pathlib import Path

import h5py
import numpy as np
from PIL import Image

from qlvbayes.diagnosis.settings import DiagnosisSettings
from qlvbayes.plots.catalogue import figures_of

STORED = json.loads((Path(__file__).parents[1] / "corpus/other/results.json").read_text())
THRESHOLDS = {"thresholds": asdict(DiagnosisSettings())}
PHASES = [("ramp", 0.0, 0.05), ("hold", 0.05, 30.0), ("unload", 30.0, 30.8),
          ("recovery", 30.8, 60.0)]  # fmt: skip
RATES = {"slow": 1.0, "fast": 32.7}
NOISE = 0.01
FIGURES = tuple(
    one.name for command in ("check", "diagnose") for one in figures_of(command) if one.shows
)


def stored(name, **changes):
    """A part of some results, with other values."""
    return deepcopy(STORED[name]) | changes


def parameter(median, unit="1", sd=0.01):
    ends = [median - 1.6 * sd, median + 1.6 * sd]
    return stored("parameter", unit=unit, mean=median, sd=sd, median=median, hdi90=ends)


def summary(pad, effects=(), **values):
    found = stored("summary", pad=pad, effects=list(effects))
    known = found["parameters"]
    noise = known.pop("noise.white")
    for name, value in values.items():
        known[name] = parameter(value, known[name]["unit"] if name in known else "1")
    for effect in effects:
        known[f"{effect}.eta"] = parameter(0.003, "N s/mm", 0.0001)
    known["noise.white"] = noise
    return found


def check(pad, effects=(), worst=1.0):
    """All cells at the noise, but for the ramp of the fast test at ``worst`` times it."""
    cells = []
    for test, rate in RATES.items():
        for phase, _, _ in PHASES:
            off = worst if (test, phase) == ("fast", "ramp") else 1.0
            role = "fit" if test == "slow" else "validate"
            place = {"test": f"{pad}-{test}", "role": role, "rate_mm_s": rate, "phase": phase}
            cells.append(stored("cell", rmse_N=NOISE * off, fails=off > 2.0, **place))
    return {"schema": 1, "pad": pad, "effects": list(effects), "noise_N": NOISE, "cells": cells}


def curves(pad, effects=(), miss=0.0, samples=80):
    """Relaxation after a ramp; the mean is off by ``miss`` during the ramp."""
    time = np.concatenate([np.linspace(a, b, samples, endpoint=False) for _, a, b in PHASES])
    phase = [kind for kind, _, _ in PHASES for _ in range(samples)]
    force = np.interp(time, [0.0, 0.05, 30.0, 30.8, 60.0], [0.0, 1.5, 0.5, 0.1, 0.2])
    noise = np.random.default_rng(1).normal(0.0, NOISE, time.size)
    mean = force - miss * np.array([kind == "ramp" for kind in phase])
    columns = {
        "time_s": time, "displacement_mm": np.interp(time, [0.0, 0.05], [0.0, 1.6]),
        "observed_N": force + noise, "mean_N": mean, "low_N": mean - 1.6 * NOISE,
        "high_N": mean + 1.6 * NOISE,
    }  # fmt: skip
    every = {name: values.tolist() for name, values in columns.items()} | {"phase": phase}
    every["phases"] = [{"kind": k, "start_s": a, "stop_s": b} for k, a, b in PHASES]
    every["left_out"] = [STORED["left_out"]]
    roles = {"slow": "fit", "fast": "validate"}
    tests = [
        every | {"test": f"{pad}-{test}", "role": roles[test], "rate_mm_s": rate}
        for test, rate in RATES.items()
    ]
    return stored("curves", pad=pad, effects=list(effects), tests=tests)


def diagnosis(pad, verdict="missing_effect", named=("viscous_drag",)):
    """Return a diagnosis; for an ambiguous verdict, ``named`` is the group."""
    effects = list(named) if verdict != "adequate" else []
    group = effects if verdict == "ambiguous" else []
    if group:
        effects = group[:1]
    ranking = [stored("ranked", effect=(named or ["friction"])[0])]
    for k, effect in enumerate([*(named or ["friction"])[1:], "inertia", "none"], 1):
        chance, lost = 0.03 / (k + 1), dict.fromkeys(("half_of_evidence", "certainty", "support"))
        numbers = {"log_bayes_factor": 300.0 - 40.0 * k, "rmse_N": 0.0101 + 0.002 * k}
        numbers |= {"inclusion": chance, "probability": chance}
        ranking.append(stored("ranked", effect=effect, **numbers, **lost))
    steps = [step([], 0.031, 0.048, 5012.0)]
    if effects:
        steps.append(step(effects, 0.0101, 0.0103, None))
    found = stored("diagnosis", pad=pad, verdict=verdict, effects=effects, group=group)
    found["outside"] = 0.9 if verdict in ("partly_explained", "unexplained") else 0.01
    found["alternatives"][0]["effects"] = found["not_ruled_out"][0]["effects"] = effects
    found["worst"]["test"] = f"{pad}-fast"
    found["settings"] |= THRESHOLDS
    return found | {"steps": steps, "ranking": ranking}


def step(effects, rmse, heldout, log_evidence):
    numbers = {"rmse_N": rmse, "heldout_rmse_N": heldout, "log_evidence": log_evidence}
    return stored("step", effects=effects, **numbers)


def comparison(first, second, answer="greater"):
    found = stored("comparison", names=[first, second])
    found["differ"] = {"greater": True, "equal": False}.get(answer)
    for contrast in found["contrasts"]:
        contrast["answer"] = answer
    return found


def picture(path, size=(400, 200), noisy=False):
    pixels = np.full((*size[::-1], 3), 255, np.uint8)
    if noisy:
        pixels = np.random.default_rng(0).integers(0, 256, pixels.shape, dtype=np.uint8)
    Image.fromarray(pixels).save(path)


def write(path, content):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content))


def facts(path, **attributes):
    path.parent.mkdir(parents=True, exist_ok=True)
    with h5py.File(path, "w") as file:
        file.attrs.update(attributes)


def write_pad(out, pad, verdict="missing_effect", named=("viscous_drag",)):
    """Everything that a study leaves of one pad."""
    folder = out / pad
    added = named if verdict == "missing_effect" else ()
    for place, effects, miss in ((folder, added, 1.0), (folder / "plain", (), 4.7)):
        miss = miss if added else 1.0
        write(place / "summary.json", summary(pad, effects, m=0.34 if effects else 0.37))
        write(place / "check.json", check(pad, effects, miss))
        write(place / "curves.json", curves(pad, effects, miss * NOISE))
    fitted = json.dumps([f"{pad}-slow"])
    facts(folder / "posterior.nc", **stored("facts", pad=pad, fitted_tests=fitted))
    write(folder / "diagnosis.json", diagnosis(pad, verdict, named))
    (folder / "diagnosis.txt").write_text(f"Pad {pad}: told in words. And more.\n\nSecond part.\n")
    for name in FIGURES:
        picture(folder / f"{name}.png")


def write_study(out):
    """A study of two pads: one lacks an effect, one lacks nothing."""
    write_pad(out, "B")
    write_pad(out, "C", "adequate", ())
    write(out / "compare" / "B-vs-C" / "compare.json", comparison("B", "C"))
    (out / "compare" / "B-vs-C" / "compare.txt").write_text("B and C differ. In v[1].\n")
    picture(out / "compare" / "B-vs-C" / "contrasts.png")
    write(out / "run.json", {"schema": 1, "runs": {"study": stored("run", settings=THRESHOLDS)}})
    return out
