"""Check predictions averaged over the hypotheses that a diagnosis left, by probability."""

from dataclasses import replace

import numpy as np
import pytest
from msgspec.structs import replace as changed
from support.endtoend import call, read_json
from support.exported_pad import write_fit
from support.posteriors import drawn, vectors, written
from support.savedfit import REACH, draws

from qlvbayes import predict_program
from qlvbayes.diagnosis.result import LawPair
from qlvbayes.fitting.results import load
from qlvbayes.io.units import PAD
from qlvbayes.model.choices import Choices
from qlvbayes.use.prescribed.hypotheses import FILE, DrawnHypothesis, Hypotheses

PROGRAM = "ramp 1.6 mm at 20 mm/s, hold 5 s"
LAWS = LawPair("exponential", "prony:2")


def hypothesis(probability, count, *effects, stiffer=1.0, **constants):
    given = draws(count, **constants)
    given["m"] = stiffer * given["m"]
    kept = {name: tuple(values.tolist()) for name, values in given.items()}
    return DrawnHypothesis(LAWS, effects, probability, kept)


def hypotheses(*some):
    return Hypotheses(pad="B", units=PAD, choices=Choices(), covered=REACH, hypotheses=some)


SOFT = hypothesis(0.75, 300)
HARD = hypothesis(0.25, 100, "viscous_drag", stiffer=2.0, **{"viscous_drag.eta": 0.01})
LATE = hypothesis(0.05, 20, "channel_lag", **{"channel_lag.delay": 0.01})
BOTH = hypotheses(SOFT, HARD)


@pytest.fixture(scope="module")
def mixed():
    return predict_program(BOTH, PROGRAM)


def test_the_band_is_that_of_the_mixture(mixed):
    """Its distribution is the sum of those of the hypotheses, weighted by their probabilities."""
    alone = [predict_program(hypotheses(one), PROGRAM) for one in (SOFT, HARD)]
    last = [one.answers[:, -1] for one in alone]
    # twice as stiff, so that they are apart: three quarters of the mixture lie below
    assert last[0].max() < last[1].min()
    between = 0.5 * (last[0].max() + last[1].min())
    assert np.mean(mixed.answers[:, -1] < between) == pytest.approx(0.75, abs=1 / 400)
    mean = 0.75 * alone[0].answers.mean(axis=0) + 0.25 * alone[1].answers.mean(axis=0)
    assert np.allclose(mixed.answers.mean(axis=0), mean, rtol=1e-9)
    low, high = mixed.band(0.9)
    assert low[-1] < last[0].max() < last[1].min() < high[-1]
    assert mixed.effects == ("viscous_drag",)
    assert mixed.averaged == (SOFT, HARD)


def test_fewer_draws_keep_the_proportions_and_what_gives_no_displacement_is_left_out():
    few = predict_program(BOTH, PROGRAM, draws=40)
    last = np.sort(few.answers[:, -1])
    assert last.size == 40
    assert np.argmax(np.diff(last)) == 29
    load_program = "force 0.3 N in 0.1 s, hold 2 s"
    found = predict_program(hypotheses(SOFT, LATE), load_program)
    assert found.averaged == (SOFT,)
    assert "exponential with prony:2 + frame" not in found.warnings[0]
    assert "exponential with prony:2 + channel_lag (0.05)" in found.warnings[0]
    alone = predict_program(hypotheses(SOFT), load_program)
    assert np.array_equal(found.answers, alone.answers)


def test_tests_that_differ_widen_the_band_by_as_much():
    """Against the relative sds given, of the stiffness and of an effect alone."""
    stiff = predict_program(hypotheses(changed(SOFT, scatter={"stiffness": 0.2})), PROGRAM)
    plain = predict_program(hypotheses(SOFT), PROGRAM)
    assert "stiffness by 20 %" in stiff.warnings[0]
    ratio = stiff.answers[:, 1:] / plain.answers[:, 1:]
    assert np.ptp(ratio, axis=1).max() < 1e-9  # each draw has one scale
    assert np.std(np.log(ratio[:, 0])) == pytest.approx(0.2, rel=0.15)
    assert np.ptp(stiff.band(0.9), axis=0)[-1] > np.ptp(plain.band(0.9), axis=0)[-1]
    drag = predict_program(hypotheses(changed(HARD, scatter={"viscous_drag": 0.5})), PROGRAM)
    without = predict_program(hypotheses(HARD), PROGRAM)
    moving = without.program.rate > 0.0
    change = drag.answers - without.answers
    assert np.allclose(change[:, ~moving], 0.0, atol=1e-12)
    expected = 0.01 * 20.0 * np.sqrt(np.exp(0.25) * (np.exp(0.25) - 1.0))
    assert np.std(change[:, np.flatnonzero(moving)[-1]]) == pytest.approx(expected, rel=0.3)
    assert drag.warnings[0].endswith("so much that a mean says little: viscous_drag")


def test_tests_that_differ_widen_the_displacement_under_a_force():
    """A specimen that is stiffer by a factor goes as deep under as much more force."""
    program = "force 0.3 N in 0.1 s, hold 2 s"
    found = predict_program(hypotheses(changed(SOFT, scatter={"stiffness": 0.2})), program)
    alone = predict_program(hypotheses(SOFT), program)
    spread = [np.std(np.log(one.answers[:, -1])) for one in (alone, found)]
    assert spread[1] > spread[0]
    back = predict_program(hypotheses(SOFT), "force 0.36 N in 0.1 s, hold 2 s").answers[:, -1]
    assert np.median(back) > np.median(found.answers[:, -1])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A pad with a fit and a diagnosis, and one with a diagnosis alone."""
    path = tmp_path_factory.mktemp("pads")
    written(path / "B", vectors(drawn("B")), {})
    BOTH.write(path / "B" / FILE)
    (path / "D").mkdir()
    changed(BOTH, pad="D").write(path / "D" / FILE)
    return path


def test_the_command_says_what_was_averaged_and_the_fit_alone_is_to_be_had(folder):
    status, _, err = call("predict", folder, "--program", PROGRAM)
    assert status == 0
    for pad in "BD":
        said = (
            f"pad {pad}: averaged over 2 hypotheses of the diagnosis, 100 % of the probability: "
            "exponential with prony:2 (0.75); exponential with prony:2 + viscous_drag (0.25)"
        )
        assert said in err.replace("\n", " ")
        content = read_json(folder / pad / "prediction.json")
        assert [one["probability"] for one in content["averaged"]] == [0.75, 0.25]
        assert content["draws"] == 400
    status, _, err = call(
        "predict", folder, "--program", PROGRAM, "--hypotheses", "fitted", "--pad", "B"
    )
    assert status == 0
    assert "averaged" not in err
    assert read_json(folder / "B" / "prediction.json")["averaged"] == []
    answer = call("predict", folder, "--program", PROGRAM, "--hypotheses", "some")
    assert answer[0] == 2
    assert "use one of averaged, fitted" in answer[2]


def test_a_diagnosis_of_other_tests_is_left_out(folder, tmp_path):
    saved = load(written(tmp_path / "B", vectors(drawn("B")), {}))
    assert saved.covered is None
    other = changed(BOTH, covered=replace(REACH, depth=2.0))
    other.write(tmp_path / "B" / FILE)
    write_fit(tmp_path)  # which says what its tests cover
    status, _, err = call("predict", tmp_path, "--program", PROGRAM)
    assert status == 0
    assert "its diagnosis is of other tests than its fit" in err.replace("\n", " ")
