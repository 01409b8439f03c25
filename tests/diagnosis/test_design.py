"""The command that proposes tests; what is promised of a test against what it then brings."""

import json
from dataclasses import replace

import numpy as np
import pytest
from blind.study import measured
from support.endtoend import PADS, call, one_line
from support.exported_pad import write_fit

from qlvbayes import InputError
from qlvbayes.diagnosis.candidate import candidate_at
from qlvbayes.diagnosis.nexttest.belief import screen
from qlvbayes.diagnosis.nexttest.design import Design, Readings
from qlvbayes.diagnosis.nexttest.planning import equal_belief, suggest
from qlvbayes.diagnosis.searchsetup import as_chosen, build_search
from qlvbayes.effects.sensors import ForceDrift, ForceOffset
from qlvbayes.inference.modes import find_mode
from qlvbayes.inference.starts import shapes
from qlvbayes.io.data import Pad
from qlvbayes.io.text import digest
from qlvbayes.io.units import PAD
from qlvbayes.model.choices import Choices
from qlvbayes.motion.experiment import prepare
from qlvbayes.pipeline.designing import design_into
from qlvbayes.simulate import HIDDEN, NOISES, TABLE_1, HiddenPad, paper_protocol, record_study


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    return write_fit(tmp_path_factory.mktemp("fitted"), source=PADS, sha256=digest(PADS))


@pytest.mark.slow
def test_the_command_leaves_a_plan_that_can_be_run(fitted):
    status, out, _ = call(
        "design", fitted, "--pad", "B", "--for", "m,b", "--minutes", 3, "--tests", 1, "--json",
        drawn=True,
    )  # fmt: skip
    assert status == 0
    (found,) = json.loads(out)
    assert found == json.loads((fitted / "B" / "design.json").read_text())
    assert (found["constants"], found["cause"]) == (["m", "b"], False)
    assert found["widths"]["m"]["after"] < found["widths"]["m"]["now"]
    (test,) = found["tests"]
    assert test["depth_mm"] <= found["limits"]["depth_mm"]
    assert {"retraction_share", "rest_s", "pause_s", "duration_s", "cycles"} < set(test)
    for name in ("set_points.csv", "design.png", "design.pdf"):
        assert (fitted / "B" / name).stat().st_size > 1000


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--pad", "Z"), "no results of pad 'Z'; name of B"),
        (("--for", "q"), "no constant 'q'; use cause, m, b"),
        (("--for", "cause"), "no diagnosis of this pad; run qlvbayes diagnose"),
        (("--minutes", "0.2"), "no test fits into 0.2 minutes"),
        (("--minutes", "-1"), "--minutes is -1; give it above 0"),
        (("--limits", "depth=0"), "--limits depth '0' are not numbers above 0"),
        (("--limits", "depth=1e-3"), "a depth of at most 0.001 mm, where the tests had"),
        (("--data", "nowhere.csv"), "nowhere.csv: the measurements are no longer here"),
    ],
)
def test_bad_input_is_one_line(fitted, words, says):
    status, out, err = call("design", fitted, *words)
    assert (status, out) == (2, "")
    assert says in one_line(err)
    with pytest.raises(InputError, match="neither a fit nor a diagnosis"):
        design_into(fitted / "B", "other", (), minutes=1.0, tests=1)


@pytest.mark.slow
def test_the_cause_of_a_pad_with_two_explanations_is_asked_for(tmp_path):
    """A drag that a set may go with: what is proposed promises to tell one from the other."""
    data, folder = tmp_path / "pad.csv", tmp_path / "out"
    hidden = "power_law_drag:k=0.003,n=0.9"
    call("simulate", "-o", data, "--pads", "B", "--rates", "0.1,1,20,100", "--max-rows", 300,
         "--hide", hidden)  # fmt: skip
    assert call("diagnose", data, "-o", folder)[0] == 0
    status, out, _ = call("design", folder, "--for", "cause", "--tests", 1, "--json")
    assert status == 0
    (found,) = json.loads(out)
    assert found["cause"]
    assert found["constants"] == []
    assert found["entropy"] > 0.3
    assert sum(found["causes"].values()) == pytest.approx(1.0)
    assert {one["cause"] for one in found["hypotheses"]} == set(found["causes"])
    (best,) = found["tests"]
    assert 0.0 <= best["cause"] <= best["cause_most"] <= found["entropy"] + 1e-9
    judged = best["judged"]
    assert best["cause"] < judged["cause"] == best["total"] < best["cause_most"]
    assert judged["cause"] > judged["cause_error"] > 0.0
    assert found["together"] == pytest.approx(judged)
    assert best["per_minute"] == pytest.approx(best["total"] / best["minutes"])
    moved = tmp_path / "elsewhere.csv"
    data.rename(moved)
    status, _, err = call("design", folder, "--for", "cause")
    assert status == 2
    assert "say where they are with --data FILE" in one_line(err)
    assert call("design", folder, "--for", "cause", "--data", PADS)[0] == 2


EFFECTS = (ForceOffset, ForceDrift)
OFFSET = 0.012  # N
HOUR = 3600.0  # s
AGAIN = 4  # noises of the further test


def ramps(seed, names, later=0.0):
    """Ramps of 20 mm/s with holds, of a pad whose force is offset."""
    pad = HiddenPad(TABLE_1["B"], (HIDDEN["force_offset"](offset=OFFSET),))
    programs = {name: paper_protocol(20.0) for name in names}
    found = measured(record_study({"B": pad}, programs, NOISES["white"], seed, 300), "B")
    return tuple(replace(test, start_s=later) for test in found.tests)


def offset_and_drift(tests):
    """Experiment, and the modes with an offset and with a drift."""
    white = Choices(noise="white")
    experiment = as_chosen(prepare(Pad("B", tests, PAD)), white)
    search = build_search(experiment, white, kinds=EFFECTS)
    search.evaluate(search.baseline)
    plain = search.modes[search.baseline][0]
    found = []
    for effect in EFFECTS:
        hypothesis = search.baseline.plus(effect.name)
        own = search.density.space.parameters(hypothesis)
        start = shapes(search.density.space, plain.point, own, effect.name)[0]
        mode = find_mode(search.density, hypothesis, start)
        found.append(candidate_at(search.density, hypothesis, mode, 0.0))
    return experiment, found


def gain(found):
    """2 ln of the evidence of the offset over that of the drift."""
    offset, drift = (one.log_evidence for one in found)
    return 2.0 * (offset - drift)


@pytest.fixture(scope="module")
def present():
    return offset_and_drift(ramps(0, ("one",)))


def test_explanations_that_are_the_same_promise_nothing(present, monkeypatch):
    """Of a pad that forgets so slowly that no test fits into the time nothing is suggested."""
    experiment, (offset, drift) = present
    same = suggest(experiment, [offset, replace(offset)])
    assert {suggestion.evidence for suggestion in same} == {0.0}
    found = suggest(experiment, [offset, drift])
    worth = [suggestion.evidence for suggestion in found]
    assert worth == sorted(worth, reverse=True)
    assert worth[0] > worth[-1] >= 0.0
    assert suggest(experiment, [drift, offset]) == found
    monkeypatch.setattr("qlvbayes.diagnosis.nexttest.planning._LONGEST", 1e-3)
    assert suggest(experiment, [offset, drift]) == []


@pytest.mark.slow
def test_the_promise_is_kept(present):
    """Press once more in an hour: the offset, which is right, gains about what was promised."""
    experiment, found = present
    again = Design(1.6, 20.0, 1000.0, hold=30.0, share=0.5, rest=30.0, wait=HOUR)
    (expected,) = screen(equal_belief(found), [again], Readings.after(experiment, 0.0)).evidence()
    first, later = ramps(0, ("one",)), experiment.scales.clock + HOUR
    gains = []
    for seed in range(1, AGAIN + 1):
        _, points = offset_and_drift(first + ramps(seed, ("again",), later))
        gains.append(gain(points) - gain(found))
    assert 0.5 * expected < np.mean(gains) < 2.0 * expected
