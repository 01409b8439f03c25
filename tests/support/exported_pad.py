"""Results of a fit written by hand, so that exports are tested without sampling anything."""

import json

import jax
import jax.numpy as jnp
import numpy as np

from qlvbayes.effects.catalogue import find
from qlvbayes.model.choices import Choices
from qlvbayes.model.drawn import described_model, drawn_models
from qlvbayes.model.parameters import fields_of
from qlvbayes.simulate import TABLE_1
from qlvbayes.use.exports.pad import read_pad
from support.posteriors import vectors, written

DATE = "2026-01-31"
PLAIN = Choices()
TESTED = {"depth": 1.6, "slowest": 0.1, "fastest": 40.0, "quickest": 0.05, "hold": 30.0, "tests": 6}
ELASTIC = {
    "exponential": {"m": 0.34, "b": 1.165},
    "linear": {"m": 0.34},
    "polynomial:2": {"m": 0.34, "k2": 0.25},
    "polynomial:3": {"m": 0.34, "k2": 0.15, "k3": 0.1},
    "toe": {"m": 0.34, "b": 1.165, "toe": 0.4},
    "hertz": {"m": 0.6, "n": 1.5},
    "spline": {f"k{j}": 0.3 + 0.2 * j for j in range(7)},
}
# constants of a size that is seen in a pad of about 1.6 N
EFFECTS = {
    "viscous_drag": (0.01,),
    "power_law_drag": (0.05, 0.4),
    "squeeze_film": (0.005, 2.5),
    "fluid_pressure": (0.2, 0.5, 0.6),
    "extra_relaxation_mode": (0.2, 1.3),
    "strain_dependent_rate": (0.5,),
    "strain_dependent_strength": (0.2,),
    "stress_softening": (0.15,),
    "friction": (0.1, 0.05),
    "permanent_set": (0.05,),
    "contact_offset": (0.1,),
    "force_offset": (0.03,),
    "channel_lag": (0.037,),  # between two steps of 0.01 s
    "fluid_leak": (0.05,),
    "levelling_leak": (0.2, 0.5),
    "force_drift": (0.02,),
    "levelling_drift": (0.1, 0.8),
    "slow_change": (0.05, 0.7, -0.4, 10.0),
    "adhesion": (0.08,),
    "adhesion_at_a_stretch": (0.08, 0.05, 0.3),
    "frame_compliance": (0.05,),
    "stiffening_frame": (0.1, 1.0),
    "pressure_friction": (0.1, 0.05, 0.6, 1.6),
    "sharp_friction": (0.1, 0.05, 0.7),
    "guide_friction": (0.1, 0.05, 0.7),
    "guide_drag": (0.01,),
    "guide_power_law_drag": (0.05, 0.4),
    "gradual_contact": (0.1, 0.15),
    "power_law_drainage": (0.2, 0.5, 0.6, 2.0, 1.6),
    "thixotropy": (0.2, 0.7, 0.4),
    "second_contact": (0.3, 0.5),
    "interface_slip": (0.08,),
    "backlash": (0.03,),
    "load_cell_creep": (0.05, 0.6),
}
RELAXATION = {
    "fung": {"c": 0.12, "tau1": 0.02, "tau2": 40.0},
    "power-law": {"c0": 0.2, "alpha": 0.3, "tau": 0.05},
    "stretched": {"c0": 0.3, "beta": 0.5, "tau": 0.8},
    "log-normal": {"c0": 0.3, "tau": 0.5, "sigma": 1.5},
}


def constants_of(choices):
    """Constants of a pad like B under these choices."""
    pad = TABLE_1["B"]
    more = max(choices.modes - len(pad.v), 0)
    shares, rates = (*pad.c, *[0.03] * more), (*pad.v, *np.geomspace(0.003, 70.0, more))
    prony = {f"c[{k}]": x for k, x in enumerate(shares)} | {
        f"v[{k}]": float(x) for k, x in enumerate(rates, 1)
    }
    found = ELASTIC[choices.elastic] | (RELAXATION | {"prony": prony})[choices.relaxation]
    for name in choices.effects:
        kind = find(name, choices.kinds)
        numbers = EFFECTS.get(name, (0.05,) * len(kind.units))
        found |= dict(zip([f"{name}.{key}" for key in kind.units], numbers, strict=True))
    return found


def reference(choices):
    """The model with these constants, as the package has it."""
    model, values = described_model(choices), constants_of(choices)
    total = sum(x for name, x in values.items() if name.startswith("c["))
    if total:
        values = {k: x / total if k.startswith("c[") else x for k, x in values.items()}
    drawn = drawn_models(model, list(values), np.array([list(values.values())]))
    return jax.tree.map(lambda x: jnp.asarray(x[0], dtype=float), drawn)


def write_fit(
    out, choices=PLAIN, *, pad="B", covered=TESTED, units=("mm", "N"), seed=0, spread=0.02,
    source="data/pads.csv", sha256="",
):  # fmt: skip
    """OUT/<pad>/posterior.nc with draws within 2 % of a pad like B; shares keep their sum."""
    rng = np.random.default_rng(seed)
    values = constants_of(choices)
    draws = {name: x * np.exp(spread * rng.normal(size=(4, 50))) for name, x in values.items()}
    if shares := [name for name in draws if name.startswith("c[")]:
        total = sum(draws[name] for name in shares)
        draws |= {name: draws[name] / total for name in shares}
    draws["noise.white"] = np.full((4, 50), 0.01)
    attrs = {
        "pad": pad, "method": "emcee", "converged": 1, "choices": json.dumps(choices.as_dict()),
        "fitted_tests": json.dumps([f"{pad}-20"]), "all_tests": 0, "fluid": "",
        "covered": json.dumps(covered) if covered else "", "source": str(source), "sha256": sha256,
        "displacement_unit": units[0], "force_unit": units[1],
    }  # fmt: skip
    written(out / pad, vectors(draws), attrs)
    assert {n for f in fields_of(described_model(choices)) for n in f.names} <= set(draws)
    return out


def exported(tmp_path, choices=PLAIN, draws=16, **options):
    """The pad as targets get it."""
    write_fit(tmp_path, choices, **options)
    return read_pad(tmp_path, options.get("pad", "B"), draws=draws, date=DATE)


def missed(pressed, force):
    """Return the errors of a force: rms and largest over the test's peak, and rms in holds.

    Test by test and phase by phase, each counting alike.
    """
    rms, still, largest = [], [], 0.0
    for i, cell in enumerate(pressed.cells):
        inside = pressed.cell == i
        of_test = [pressed.cells[j].test == cell.test for j in pressed.cell]
        off = (force - pressed.measured)[inside] / np.max(pressed.measured[of_test])
        rms.append(np.mean(off**2))
        largest = max(largest, np.max(np.abs(off)))
        if cell.phase in ("hold", "recovery"):
            still.append(np.mean(off**2))
    return np.sqrt(np.mean(rms)), largest, np.sqrt(np.mean(still))
