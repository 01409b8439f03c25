"""Hidden effects: limits, refinement, physics, sizes, and the command that hides them."""

import json

import numpy as np
import pytest
from blind.catalogue import FORMS, OUTSIDE
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
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
def test_without_effects_it_is_the_pad(protocol, bonded):
    rng = np.random.default_rng(3)
    for constants in (B, draw_constants(rng), Constants(0.5, 0.6, (1.0,))):
        for rate in (0.1, 20.0, 100.0):
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
@pytest.mark.few(2)
def test_finer_cells_and_another_order_change_nothing(names):
    platen, times = paired(full_retraction_protocol)
    effects = [effect(name) for name in names]
    force = force_of(*effects, platen=platen, times=times)
    finer = force_of(*effects, platen=platen, times=times, cells=1800)
    assert np.abs(force - finer).max() < 1e-6 * finer.max()
    back = force_of(*effects[::-1], platen=platen, times=times)
    assert np.array_equal(force, back)


def integrated(platen, times, slope, states):
    """Solve y' = slope(d, velocity, y) from 0 with the platen's d, piece by piece."""
    values, state = np.zeros((states, times.size)), np.zeros(states)
    for piece in platen.pieces:
        end = piece.start + piece.duration
        inside = (times >= piece.start) & (times < end)

        def local(t, y, p=piece):
            tau = t - p.start
            speed = p.velocity + p.acceleration * tau
            return slope(p.displacement + tau * 0.5 * (p.velocity + speed), speed, y)

        solution = solve_ivp(
            local, (piece.start, end), state, "LSODA", np.append(times[inside], end),
            rtol=1e-10, atol=1e-12,
        )  # fmt: skip
        values[:, inside], state = solution.y[:, :-1], solution.y[:, -1]
        values[:, times >= end] = state[:, None]
    return values


def stiffness(d):
    return B.m * np.exp(B.b * d)


def elastic(d):
    return B.m / B.b * np.expm1(B.b * d)


def ringing(d, v, y):
    """w' and w'' of an oscillator that obeys w'' + 2 g w' + (g^2 + W^2) (w - a) = 0.

    With w = u' its speed u stands for a: u'' + 2 g u' + (g^2 + W^2) (u - v) = 0.
    """
    turn = 20.0 * np.pi
    return np.array([y[1], (1.01 * turn**2) * (v - y[0]) - 0.2 * turn * y[1]])


REFERENCES = {
    "strain_dependent_rate": (
        lambda d, v, y: stiffness(d) * v - np.array(B.v) * np.exp(0.5 * d) * y,
        lambda q: 0.0,
    ),
    "linear_rate": (
        lambda d, v, y: stiffness(d) * v - np.array(B.v) * (1 + 0.5 * d) * y,
        lambda q: 0.0,
    ),
    "fluid_pressure": (lambda d, v, y: 0.1 * v - y[2] / 0.5 * np.exp(-0.5 * d), lambda p: p[2]),
    "quadratic_pressure": (lambda d, v, y: 0.1 * v - 20 * y[2] * np.abs(y[2]), lambda p: p[2]),
    "friction": (lambda d, v, y: v / 0.05 * (1 - y[2] * np.sign(v)), lambda z: 0.08 * z[2]),
    "frame_ringing": (
        lambda d, v, y: ringing(d, v, y[2:]),
        lambda u: 0.004 / (20.0 * np.pi) * u[3],
    ),
}


@pytest.mark.parametrize("name", REFERENCES)
def test_states_agree_with_a_general_solver(name):
    law, added = REFERENCES[name]
    changes_modes = name.endswith("rate")

    def slope(d, v, y):
        plain = stiffness(d) * v - np.array(B.v) * y[:2]
        return law(d, v, y) if changes_modes else np.append(plain, law(d, v, y))

    for protocol in (paper_protocol, full_retraction_protocol):
        platen, times = paired(protocol, 30.0)
        states = {"linear_rate": 2, "strain_dependent_rate": 2, "frame_ringing": 4}.get(name, 3)
        y = integrated(platen, times, slope, states)
        expected = B.c[0] * elastic(platen.displacement(times)) + B.c[1:] @ y[:2] + added(y)
        force = force_of(effect(name), platen=platen, times=times, bonded=True)
        assert np.abs(force - expected).max() < 1e-7 * expected.max()


def test_a_compliant_frame_agrees_with_a_general_solver():
    """w' = v (F_e - w), with the depth found by root search at every step."""
    c, v = np.array(B.c), np.array(B.v)

    def depth(displacement, w):
        def surplus(d):
            return d - displacement + 0.05 * max(elastic(d) - c[1:] @ w, 0.0)

        return brentq(surplus, displacement - 0.5, displacement + 1e-9, xtol=1e-14)

    platen, times = paired(paper_protocol, 30.0)
    w = integrated(platen, times, lambda d, _, w: v * (elastic(depth(d, w)) - w), 2)
    pressed = [depth(d, x) for d, x in zip(platen.displacement(times), w.T, strict=True)]
    expected = np.maximum(elastic(np.array(pressed)) - c[1:] @ w, 0.0)
    force = force_of(effect("frame_compliance"), platen=platen, times=times)
    assert np.abs(force - expected).max() < 1e-6 * expected.max()


def study(protocol, pad):
    programs = {f"{rate:g}": protocol(rate) for rate in PAPER_RATES}
    return record_study({"P": pad}, programs, NOISES["none"], 0, 500)


@pytest.fixture(scope="module")
def bare():
    """Forces of the bare pad in both protocols."""
    protocols = paper_protocol, full_retraction_protocol
    return {p: [test.record.true_force for test in study(p, HiddenPad(B))] for p in protocols}


@pytest.mark.parametrize("name", EVERY)
@pytest.mark.few(4)
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
