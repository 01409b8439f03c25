"""A folder of results written by hand, so that reports are tested without fitting anything."""

import json
from dataclasses import asdict

import h5py
import numpy as np
from PIL import Image

from qlvbayes.diagnosis.settings import DiagnosisSettings
from qlvbayes.plots.catalogue import figures_of

PHASES = [
    ("ramp", 0.0, 0.05),
    ("hold", 0.05, 30.0),
    ("unload", 30.0, 30.8),
    ("recovery", 30.8, 60.0),
]
RATES = {"slow": 1.0, "fast": 32.7}
NOISE = 0.01
FIGURES = tuple(
    one.name for command in ("check", "diagnose") for one in figures_of(command) if one.shows
)


def parameter(median, unit="1", sd=0.01):
    ends = [median - 1.6 * sd, median + 1.6 * sd]
    return {
        "unit": unit,
        "mean": median,
        "sd": sd,
        "median": median,
        "hdi90": ends,
        "r_hat": None,
        "ess_bulk": 900.0,
    }


def summary(pad, effects=(), **values):
    constants = {"m": 0.34, "b": 1.165, "c[0]": 0.2955, "c[1]": 0.63, "v[1]": 6.215} | values
    units = {"m": "N/mm", "b": "1/mm", "v[1]": "1/s"}
    parameters = {name: parameter(value, units.get(name, "1")) for name, value in constants.items()}
    for effect in effects:
        parameters[f"{effect}.eta"] = parameter(0.003, "N s/mm", 0.0001)
    parameters["noise.white"] = parameter(NOISE, "N", 0.001)
    return {
        "schema": 1,
        "pad": pad,
        "effects": list(effects),
        "sampler": "emcee",
        "converged": True,
        "troubles": [],
        "parameters": parameters,
    }


def check(pad, effects=(), worst=1.0):
    """All cells at the noise, but for the ramp of the fast test at ``worst`` times it."""
    cells = [
        {
            "test": f"{pad}-{test}",
            "role": "fit" if test == "slow" else "validate",
            "rate_mm_s": rate,
            "phase": phase,
            "n": 100,
            "rmse_N": NOISE * (worst if (test, phase) == ("fast", "ramp") else 1.0),
            "bias_N": 0.002,
            "coverage90": 0.9,
            "p_value": 0.5,
            "fails": (test, phase) == ("fast", "ramp") and worst > 2.0,
            "limit_N": 2.0 * NOISE,
        }
        for test, rate in RATES.items()
        for phase, _, _ in PHASES
    ]
    return {"schema": 1, "pad": pad, "effects": list(effects), "noise_N": NOISE, "cells": cells}


def curves(pad, effects=(), miss=0.0, samples=80):
    """Relaxation after a ramp; the mean is off by ``miss`` during the ramp."""
    time = np.concatenate([np.linspace(a, b, samples, endpoint=False) for _, a, b in PHASES])
    phase = [kind for kind, _, _ in PHASES for _ in range(samples)]
    force = np.interp(time, [0.0, 0.05, 30.0, 30.8, 60.0], [0.0, 1.5, 0.5, 0.1, 0.2])
    noise = np.random.default_rng(1).normal(0.0, NOISE, time.size)
    mean = force - miss * np.array([kind == "ramp" for kind in phase])
    tests = [
        {
            "test": f"{pad}-{test}",
            "role": "fit" if test == "slow" else "validate",
            "rate_mm_s": rate,
            "phases": [{"kind": k, "start_s": a, "stop_s": b} for k, a, b in PHASES],
            "time_s": time.tolist(),
            "phase": phase,
            "displacement_mm": np.interp(time, [0.0, 0.05], [0.0, 1.6]).tolist(),
            "observed_N": (force + noise).tolist(),
            "mean_N": mean.tolist(),
            "low_N": (mean - 1.6 * NOISE).tolist(),
            "high_N": (mean + 1.6 * NOISE).tolist(),
            "left_out": [
                {
                    "time_s": 5.0,
                    "displacement_mm": 0.0,
                    "force_N": 0.5,
                    "channel": "displacement",
                    "kind": "lost",
                }
            ],
        }
        for test, rate in RATES.items()
    ]
    return {
        "schema": 1,
        "pad": pad,
        "effects": list(effects),
        "force_unit": "N",
        "force_name": "force",
        "speed_unit": "mm/s",
        "displacement_unit": "mm",
        "displacement_name": "displacement",
        "noise_N": NOISE,
        "tests": tests,
    }


LAWS = {"elastic": "exponential", "relaxation": "prony:2"}
SUPPORT = {
    "heldout_gain": 1.5,
    "heldout_sds": 3.0,
    "heldout": 0.011,
    "error_left": 0.01,
    "p_left": 0.4,
    "effects": 1,
    "strengths": None,
}
HALF = {"block_means": 21, "of": 956, "test": "fast", "phase": "ramp", "time_s": 0.031}


def diagnosis(pad, verdict="missing_effect", named=("viscous_drag",)):
    """Return a diagnosis; for an ambiguous verdict, ``named`` is the group."""
    effects = list(named) if verdict != "adequate" else []
    group = effects if verdict == "ambiguous" else []
    if group:
        effects = group[:1]
    ranking = [
        {
            "effect": effect,
            "inclusion": 0.97 if k == 0 else 0.03 / (k + 1),
            "probability": 0.97 if k == 0 else 0.03 / (k + 1),
            "log_bayes_factor": 300.0 - 40.0 * k,
            "rmse_N": 0.0101 + 0.002 * k,
            "parameters": {"eta": {"unit": "N s/mm", "mean": 0.003, "sd": 1e-4}},
            "inclusion_error": 0.001,
            "half_of_evidence": HALF if k == 0 else None,
            "certainty": 0.9 if k == 0 else None,
            "support": SUPPORT if k == 0 else None,
        }
        for k, effect in enumerate([*(named or ["friction"]), "inertia", "none"])
    ]
    steps = [step([], 0.031, 0.048, 5012.0)]
    if effects:
        steps.append(step(effects, 0.0101, 0.0103, None))
    return {
        "schema": 1,
        "pad": pad,
        "noise_N": NOISE,
        "verdict": verdict,
        "effects": effects,
        "group": group,
        "base": LAWS | {"probability": 0.98},
        "bases": [LAWS | {"probability": 0.98}],
        "outside": 0.9 if verdict in ("partly_explained", "unexplained") else 0.01,
        "alternatives": [
            {
                "base": LAWS,
                "effects": effects,
                "probability": 0.9,
                "log_evidence": 6650.0,
                "log_evidence_error": 0.1,
            }
        ],
        "not_ruled_out": [{"effects": effects, "probability": 0.9}],
        "steps": steps,
        "ranking": ranking,
        "not_identifiable": [{"effect": "adhesion", "reason": "no test retracts"}],
        "suggestions": [],
        "worst": {"test": f"{pad}-fast", "phase": "ramp", "rmse_N": 0.19, "bias_N": 0.17},
        "settings": {
            "thresholds": asdict(DiagnosisSettings()),
            "seed": 7,
            "elastic": ["exponential"],
            "relaxation": ["prony:2"],
            "effects": ["viscous_drag", "friction", "inertia"],
        },
    }


def step(effects, rmse, heldout, log_evidence):
    found = {"base": LAWS, "effects": effects, "rmse_N": rmse, "heldout_rmse_N": heldout}
    found |= {"log_evidence": log_evidence, "adequacy_p_value": 0.5, "noise_testable": True}
    return found | {"failing": [], "cells": [], "parameters": {}}


def comparison(first, second, answer="greater"):
    interval = {"median": 1.4, "low": 1.3, "high": 1.5}
    contrast = {
        "quantity": "v[1]",
        "first": interval,
        "second": interval,
        "unit": "1/s",
        "difference": interval,
        "ratio": None,
        "direction": 0.9999,
        "equivalence": 0.0,
        "answer": answer,
        "group": "constants",
        "extrapolated": False,
        "ratio95": None,
    }
    contrasts = [contrast, contrast | {"quantity": "m", "ratio": interval, "extrapolated": True}]
    return {
        "schema": 1,
        "names": [first, second],
        "between": "pads",
        "region": 0.1,
        "differ": {"greater": True, "equal": False}.get(answer),
        "contrasts": contrasts,
        "notices": ["fitted with different effects"],
    }


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
    facts(
        folder / "posterior.nc",
        pad=pad,
        method="emcee",
        source="/somewhere/pads.csv",
        sha256="ab" * 32,
        seed=7,
        priors=json.dumps({"m": "lognormal(0.2953, 1.609)"}),
        fitted_tests=json.dumps([f"{pad}-slow"]),
        force_unit="N",
        displacement_unit="mm",
        qlvbayes_version="0.1.0",
        choices=json.dumps({"law": "exponential", "modes": 2, "noise": "correlated"}),
    )
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
    runs = {
        "study": {
            "command": "qlvbayes study data/pads.csv -o results --seed 7",
            "source": "/somewhere/pads.csv",
            "sha256": "ab" * 32,
            "seed": 7,
            "choices": {"law": "exponential", "modes": 2, "noise": "correlated"},
            "versions": {"python": "3.11.7", "jax": "0.10.2"},
            "settings": {"thresholds": asdict(DiagnosisSettings())},
        }
    }
    write(out / "run.json", {"schema": 1, "runs": runs})
    return out
