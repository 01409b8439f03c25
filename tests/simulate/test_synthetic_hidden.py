"""Hidden effects: limits, refinement, physics, sizes, and the command that hides them."""

import json

import numpy as np
import pytest
from blind.catalogue import FORMS, OUTSIDE
from support.machine_files import CORPUS
from typer.testing import CliRunner

from qlvbayes.cli.main import application
from qlvbayes.io.checks import InputError
from qlvbayes.simulate import (
    HIDDEN,
    NOISES,
    PAPER_RATES,
    TABLE_1,
    Constants,
    HiddenPad,
    Pad,
    Platen,
    draw_constants,
    draw_effect,
    full_retraction_protocol,
    paper_protocol,
    record_study,
)

EVERY = {**HIDDEN, **FORMS, **OUTSIDE}
B = TABLE_1["B"]
PARAMETERS = json.loads((CORPUS / "other/constants.json").read_text("utf-8"))["simulated"]


def effect(name, **changes):
    return EVERY[name](**{**PARAMETERS[name], **changes})


def paired(protocol, rate=20.0, start_s=300.0):
    platen = Platen(protocol(rate), start_s=start_s, number=2)
    around = platen.kinks[:, None] + [0.0, 1e-3, 1e-2, 0.1]
    times = np.append(around.ravel(), np.linspace(0.0, platen.duration, 200))
    return platen, np.unique(times[times <= platen.duration])


def force_of(*effects, platen, times, constants=B, **options):
    return HiddenPad(constants, effects, **options).force(platen, times)


@pytest.mark.parametrize("bonded", [False, True])
@pytest.mark.parametrize("protocol", [paper_protocol, full_retraction_protocol])
@pytest.mark.few(2)
def test_without_effects_it_is_the_pad(protocol, bonded):
    rng = np.random.default_rng(3)
    for constants in (B, draw_constants(rng), Constants(0.5, 0.6, (1.0,))):
        for rate in (0.1, 100.0):
            platen, times = paired(protocol, rate)
            expected = Pad(constants, bonded).force(platen, times)
            force = force_of(platen=platen, times=times, constants=constants, bonded=bonded)
            assert np.abs(force - expected).max() < 1e-8 * expected.max()


@pytest.mark.parametrize(
    "names",
    [
        ("frame_compliance", "fluid_pressure", "stress_softening"),
        ("strain_dependent_rate", "extra_relaxation_mode", "strain_dependent_strength"),
        ("adhesion", "friction", "channel_lag"),
    ],
)
@pytest.mark.few(1)
def test_finer_cells_and_another_order_change_nothing(names):
    platen, times = paired(full_retraction_protocol)
    effects = [effect(name) for name in names]
    force = force_of(*effects, platen=platen, times=times)
    finer = force_of(*effects, platen=platen, times=times, cells=1800)
    assert np.abs(force - finer).max() < 1e-6 * finer.max()
    back = force_of(*effects[::-1], platen=platen, times=times)
    assert np.array_equal(force, back)


def study(protocol, pad):
    programs = {f"{rate:g}": protocol(rate) for rate in PAPER_RATES}
    return record_study({"P": pad}, programs, NOISES["none"], 0, 500)


@pytest.fixture(scope="module")
def bare():
    """Forces of the bare pad in both protocols."""
    protocols = paper_protocol, full_retraction_protocol
    return {p: [test.record.true_force for test in study(p, HiddenPad(B))] for p in protocols}


@pytest.mark.parametrize("name", EVERY)
@pytest.mark.few(3)
def test_drawn_effects_have_the_size_asked_for(name, bare):
    on_return = name in ("stress_softening", "exponential_softening", "adhesion")
    protocol = full_retraction_protocol if on_return else paper_protocol
    peak = max(force.max() for force in bare[protocol])
    size = 0.05
    hidden = draw_effect(EVERY[name], np.random.default_rng(7), peak, 1.6, 100.0, size, B)
    tests = study(protocol, HiddenPad(B, (hidden,)))
    found = [
        np.abs(test.record.true_force - force).max()
        for test, force in zip(tests, bare[protocol], strict=True)
    ]
    assert 0.5 * size < max(found) / peak < 2.0 * size


def test_parameters_out_of_range_are_refused():
    for name, changes in (
        ("viscous_drag", {"eta": -1.0}),
        ("power_law_drag", {"n": 0.0}),
        ("power_law_drag", {"n": 1.5}),
        ("friction", {"reach": 0.0}),
        ("force_offset", {"offset": np.inf}),
        ("fluid_pressure", {"tau": np.nan}),
    ):
        with pytest.raises(InputError, match=name):
            effect(name, **changes)
    with pytest.raises(InputError, match="viscous_drag"):
        draw_effect("drag", np.random.default_rng(0), 1.0, 1.6, 100.0, 0.05)


def simulate(*words):
    result = CliRunner().invoke(
        application(), ["simulate", "--pads", "B", "--rates", "20", *map(str, words)]
    )
    return result


WORDS = ("--max-rows", "200", "--hide", "viscous_drag:eta=0.003", "--hide", "friction")


def test_the_command_tells_what_it_hides_unless_there_is_an_answer(tmp_path):
    data, secret, answer = tmp_path / "a.csv", tmp_path / "b.csv", tmp_path / "b.json"
    assert simulate("-o", data, *WORDS).exit_code == 0
    assert simulate("-o", secret, *WORDS, "--answer", answer).exit_code == 0
    open_lines, secret_lines = data.read_text().splitlines(), secret.read_text().splitlines()
    heading = [line for line in secret_lines if line.startswith("#")]
    assert "# hidden: viscous_drag (eta = 0.003)" in open_lines
    assert not any(word in " ".join(heading) for word in ("drag", "friction", "--hide", "m ="))
    assert [x for x in open_lines if x[0] != "#"] == [x for x in secret_lines if x[0] != "#"]
    content = json.loads(answer.read_text())
    assert content["effects"][0] == {"effect": "viscous_drag", "parameters": {"eta": 0.003}}
    assert content["effects"][1]["effect"] == "friction"
    assert content["constants"]["B"]["m"] == B.m
    assert content["seed"] == 0
