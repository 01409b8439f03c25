"""Posteriors of other programs with our names of the constants: loaded, checked and compared."""

import numpy as np
import pytest
from support.endtoend import PADS, call, read_json
from support.posteriors import CHAINS, drawn, vectors, written

from qlvbayes.fitting.results import load
from qlvbayes.io.checks import InputError
from qlvbayes.io.units import PAD, STRAIN
from qlvbayes.model.drawn import flat_names, infer_choices


def same_as(saved, flat):
    """What the posterior does not say of its noise is that nothing was added to it."""
    every = flat | {"noise.factor": np.ones(CHAINS), "noise.remainder": np.zeros(CHAINS)}
    assert set(saved.names) == set(every)
    np.testing.assert_allclose(saved.constants, np.stack([every[k] for k in saved.names], axis=-1))


def test_scalars_named_by_index_are_read(tmp_path):
    flat = drawn()
    saved = load(written(tmp_path / "B", flat))
    same_as(saved, flat)
    assert (saved.pad, saved.source, saved.fitted, saved.fluid) == ("B", "", (), None)
    assert (saved.choices.elastic, saved.choices.modes, saved.choices.noise) == (
        "exponential", 2, "floor"
    )  # fmt: skip
    assert saved.units == PAD
    assert not saved.choices.bonded


@pytest.mark.parametrize(
    "options",
    [
        {},  # ArviZ counts from 0
        {"dims": {"c": ["k"], "v": ["i"]}, "coords": {"k": [0, 1, 2], "i": [1, 2]}},
        {"dims": {"c": ["k"], "v": ["i"]}, "coords": {"k": ["a", "b", "d"], "i": ["x", "y"]}},
    ],
)
def test_vectors_are_read_whatever_their_dimensions_are_called(tmp_path, options):
    flat = drawn()
    saved = load(written(tmp_path / "B", vectors(flat), **options))
    same_as(saved, flat)


def test_vectors_count_as_in_the_paper_and_attributes_of_our_names_are_heeded(tmp_path):
    assert flat_names("c", [0, 1, 2], 3) == ["c[0]", "c[1]", "c[2]"]
    assert flat_names("v", [0, 1], 2) == flat_names("v", [1, 2], 2) == ["v[1]", "v[2]"]
    assert flat_names("v", [], 2) == ["v[1]", "v[2]"]
    attrs = {"pad": "my pad", "fluid": "oil", "source": "a.csv", "displacement_unit": "1"}
    saved = load(written(tmp_path / "x", drawn(), attrs))
    assert (saved.pad, saved.fluid, saved.source) == ("my pad", "oil", "a.csv")
    assert saved.units == STRAIN
    assert saved.choices.bonded


@pytest.mark.parametrize(
    ("names", "wanted"),
    [
        (["m", "c[0]", "c[1]", "v[1]"], ("linear", 1, "white", ())),
        (["m", "n", "c[0]", "c[1]", "v[1]", "noise.white"], ("hertz", 1, "white", ())),
        (
            ["m", "b", "c[0]", "c[1]", "v[1]", "noise.white", "viscous_drag.eta"],
            ("exponential", 1, "white", ("viscous_drag",)),
        ),
    ],
)
def test_the_model_follows_from_the_names(names, wanted):
    found = infer_choices(names)
    assert (found.elastic, found.modes, found.noise, found.effects) == wanted


def changed(**changes):
    flat = drawn()
    flat = {k: x for k, x in flat.items() if k not in changes or changes[k] is not None}
    return flat | {k: x for k, x in changes.items() if x is not None}


@pytest.mark.parametrize(
    ("variables", "problem"),
    [
        (changed(m=None), "has no m, the stiffness"),
        (
            changed(**{"v[2]": None}),
            r"lacks v\[2\]; a model of 2 relaxation modes has m, b, c\[0\]",
        ),
        (changed(**{"c[0]": None}), r"lacks c\[0\]"),
        (changed(**{"noise.white": None}), "noise has only noise.ou, noise.tau"),
        (changed(**{"fluid_pressure.k": np.ones(CHAINS)}), "lacks fluid_pressure.tau"),
        (changed(**{"stickiness.k": np.ones(CHAINS)}), "no effect 'stickiness'"),
        (changed(m=np.full(CHAINS, np.nan)), "m has draws that are not finite"),
        (changed(**{"c[1]": np.full(CHAINS, 0.5)}), "do not sum to 1"),
        (changed(**{"v[1]": np.full(CHAINS, 0.01)}), r"v\[1\] is below v\[2\]"),
        ({k: x[:, :10] for k, x in drawn().items()}, "only 40 draws"),
    ],
)
def test_what_is_missing_is_named(tmp_path, variables, problem):
    path = written(tmp_path / "B", variables)
    with pytest.raises(InputError, match=problem) as caught:
        load(path)
    assert str(caught.value).startswith(f"{path}: ")


def test_check_predicts_from_a_posterior_made_elsewhere_or_says_what_is_missing(tmp_path):
    """Draws about the truth: a test that nobody fitted is predicted to a few per cent."""
    written(tmp_path / "B", vectors(drawn()))
    status, _, err = call("check", tmp_path)
    assert status == 2
    assert "does not say where its measurements are; say where they are with --data FILE" in err
    data = tmp_path / "one.csv"
    lines = PADS.read_text().splitlines(keepends=True)
    data.write_text("".join(x for x in lines if x.startswith(("#", "pad,", "B,B-20,"))))
    status, _, err = call("check", tmp_path, "--data", data, "--json")
    assert (status, err) == (0, "")
    cells = read_json(tmp_path / "B" / "check.json")["cells"]
    assert [cell["phase"] for cell in cells] == ["ramp", "hold", "unload", "recovery"]
    # N: the centres of m, b and c are off by a few of their sds of 1 to 5 %
    assert max(cell["rmse_N"] for cell in cells) < 0.1 * 1.6
    written(tmp_path / "without" / "B", drawn(noise=()))
    status, _, err = call("check", tmp_path / "without", "--data", PADS)
    assert status == 2
    assert "the posterior of pad B has no noise; give draws of noise.white" in err


@pytest.mark.slow
def test_compare_works_on_them_alone_and_better_with_the_data(tmp_path):
    for seed, pad in enumerate("BC"):
        written(tmp_path / pad, vectors(drawn(pad, seed)))
    status, _, err = call("compare", tmp_path, "--json")
    assert (status, err) == (0, "")
    alone = read_json(tmp_path / "compare" / "B-vs-C" / "compare.json")
    assert any("tests are not known" in notice for notice in alone["notices"])
    status, _, err = call("compare", tmp_path, "--data", PADS)
    assert (status, err) == (0, "")
    known = read_json(tmp_path / "compare" / "B-vs-C" / "compare.json")
    assert known["settings"]["depth"] == 1.5
    assert not any("not known:" in notice for notice in known["notices"])
    assert known["differ"] is True
