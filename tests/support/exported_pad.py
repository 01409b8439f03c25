"""Results of a fit written by hand, so that exports are tested without sampling anything."""

import json
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from qlvbayes.diagnosis.description.grammar import grammar
from qlvbayes.diagnosis.description.source import References, name_of, source_of
from qlvbayes.effects.catalogue import find
from qlvbayes.io.units import PAD
from qlvbayes.model.choices import Choices
from qlvbayes.model.drawn import described_model, drawn_models
from qlvbayes.model.parameters import fields_of
from qlvbayes.simulate import TABLE_1
from qlvbayes.use.exports.pad import read_pad
from support.posteriors import vectors, written

DATE = "2026-01-31"
PLAIN = Choices()
CORPUS = Path(__file__).parents[1] / "corpus"
# those of effects are of a size that is seen in a pad of about 1.6 N
_STORED = json.loads((CORPUS / "other/constants.json").read_text("utf-8"))
ELASTIC, EFFECTS, RELAXATION = (_STORED[key] for key in ("elastic", "effects", "relaxation"))
TESTED = {"depth": 1.6, "slowest": 0.1, "fastest": 40.0, "quickest": 0.05, "hold": 30.0, "tests": 6}


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


def described(folder, *names):
    """Choices with a law that a diagnosis described, of some terms, in a file of a folder."""
    terms = [next(one for one in grammar() if one.name == name) for name in names]
    path = folder / "described_effect.py"
    references = References(1.6, 100.0, 1000.0, 1.5, 500.0)
    path.write_text(source_of(terms, references, PAD, "It describes tests."), encoding="utf-8")
    return Choices(effects=(name_of(terms),), effects_file=str(path))


def missed(pressed, force):
    """Return the errors of a force: rms and largest over the test's peak, and rms in holds."""
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
