"""How often an effect would be named: pads are simulated, stored and counted."""

import json

import numpy as np
import pytest
from support.endtoend import PADS, call

from qlvbayes.evaluation import store
from qlvbayes.evaluation.session import RigSession, _of_programme
from qlvbayes.evaluation.store import Store, code_digest, run_missing
from qlvbayes.evaluation.study import NOTHING, Benchmark, effects_of
from qlvbayes.evaluation.table import outcome, rows
from qlvbayes.io.checks import InputError
from qlvbayes.io.data import read_measurements
from qlvbayes.motion.experiment import prepare
from qlvbayes.simulate import HIDDEN, NOISES, PAPER_ACCELERATION, TABLE_1

PLAN = "a plan"


def test_finished_studies_are_not_run_again(tmp_path):
    ran, reported = [], []

    def pretend(index):
        ran.append(index)
        return {"plan": PLAN, "index": index}

    key, path = PLAN, tmp_path / "a" / "store.jsonl"
    run_missing(pretend, Store(path, key), range(2), code="c")
    run_missing(pretend, Store(path, key), range(4), lambda *x: reported.append(x), code="c")
    assert ran == [0, 1, 2, 3]
    assert reported == [(0, 2), (1, 2), (2, 2)]
    assert Store(path, key).missing(6) == [4, 5]
    assert not Store(path, "another").cases
    assert sorted(Store(path).cases) == [0, 1, 2, 3]


def test_parts_of_several_processes_are_read_together_and_cut_lines_removed(tmp_path):
    path, key = tmp_path / "store.jsonl", PLAN
    for part in (0, 1):
        for index in (part, part + 2):
            Store(path, key, part).add({"plan": PLAN, "index": index})
    cut = tmp_path / "store.jsonl.1"
    cut.write_text(cut.read_text()[:-30])
    assert sorted(Store(path, key).cases) == [0, 1, 2]
    Store(path, key, 1).add({"plan": PLAN, "index": 3})
    assert sorted(Store(path, key).cases) == [0, 1, 2, 3]
    assert [c["index"] for c in Store(path, key).first(3)] == [0, 1, 2]


def test_the_digest_is_of_code_that_may_change_an_outcome(tmp_path):
    """Not of words about it, nor of code that only looks at what came out."""
    law, figure = tmp_path / "laws" / "hertz.py", tmp_path / "plots" / "bars.py"
    for file in (law, figure):
        file.parent.mkdir()
        file.write_text("POWER = 1.5\n")
    first = code_digest(tmp_path)
    law.write_text('"""Of a sphere."""\n\nPOWER = 1.5  # Hertz 1881\n')
    figure.write_text("POWER = 2.0\n")
    assert code_digest(tmp_path) == first
    law.write_text("POWER = 2.0\n")
    assert code_digest(tmp_path) != first
    law.rename(law.with_name("sphere.py"))
    figure.rename(tmp_path / "laws" / "hertz.py")
    assert code_digest(tmp_path) != first


B = TABLE_1["B"]


@pytest.fixture(scope="module")
def measured():
    """Pad B of the bundled file, which was simulated with the constants of the paper's table."""
    return read_measurements(PADS).pad("B")


@pytest.fixture(scope="module")
def session(measured):
    return RigSession.of_pad(measured)


def test_a_file_gives_its_pad_whose_readings_are_like_its_own(measured, session):
    found = session.constants
    assert found.m == pytest.approx(B.m, rel=0.05)
    assert found.b == pytest.approx(B.b, rel=0.05)
    assert found.c == pytest.approx(B.c, abs=0.02)
    assert found.v == pytest.approx(B.v, rel=0.2)
    assert session.encoder == pytest.approx(1e-3)
    for test, motion, times in zip(measured.tests, session.motions, session.times, strict=True):
        assert times.size == test.time.size
        off = motion.displacement(times) - test.displacement
        assert np.sqrt(np.mean(off**2)) < 1e-3  # mm, the encoder's step
    # their difference is the noise of both, and their noise floor is that of the file
    again, hidden = Benchmark(session, 0.06, 0).measured(NOTHING, 0)
    assert hidden == {"share": 0.0, "parameters": {}}
    noise = prepare(measured).floor.total
    for old, new in zip(measured.tests, again.tests, strict=True):
        rms = np.sqrt(np.mean((old.force - new.force) ** 2))
        assert rms < 3.0 * noise
    assert prepare(again).floor.total == pytest.approx(noise, rel=0.3)


def test_a_programme_is_driven_as_a_platen_can():
    """It is on the straight lines but near their corners, within its largest acceleration."""
    track = _of_programme("ramp 1.6 mm at 20 mm/s, hold 2 s, ramp 0.4 mm at 5 mm/s", 0)
    begin, end = 0.05, 0.05 + 0.08 + 2.0 + 0.24
    assert track.duration == pytest.approx(end)
    assert track.displacement([begin + 0.04, begin + 1.0, end]) == pytest.approx([0.8, 1.6, 0.4])
    time = np.linspace(0.0, end, 100_000, endpoint=False)
    assert np.max(np.abs(track.acceleration(time))) <= PAPER_ACCELERATION * (1 + 1e-9)
    assert np.max(np.abs(np.diff(track.velocity(time)))) < 0.03  # mm/s: it does not jump
    with pytest.raises(InputError, match="prescribes a force"):
        _of_programme("force 1 N in 0.1 s", 0)


def test_an_effect_has_its_size_and_each_pad_its_own_numbers():
    session = RigSession.of_the_paper(B, NOISES["correlated"])
    session = session.with_programmes(["ramp 1.6 mm at 20 mm/s, hold 5 s", "ramp 1 mm in 10 s"])
    simulated = Benchmark(session, 0.06, 1)
    pad, hidden = simulated.measured("friction", 0)
    assert hidden["share"] == pytest.approx(0.06, rel=0.1)
    assert [test.name for test in pad.tests] == ["programme 1", "programme 2"]
    same, _ = simulated.measured("friction", 0)
    _, drawn = simulated.measured("friction", 1)
    assert np.array_equal(pad.tests[0].force, same.tests[0].force)
    assert drawn["parameters"] != hidden["parameters"]
    assert Benchmark(session, 0.06, 2).key != simulated.key


def test_only_effects_of_a_pad_held_like_that_are_hidden():
    assert set(effects_of((), bonded=True)) == set(HIDDEN)
    assert set(HIDDEN) - set(effects_of((), bonded=False)) == {"interface_slip"}
    with pytest.raises(InputError, match="no effect 'rust'"):
        effects_of(("rust",), bonded=False)


def case(hidden="friction", verdict="missing_effect", effects=(), group=(), share=0.06):
    found = {"hidden": hidden, "verdict": verdict, "share": share}
    return found | {"effects": list(effects), "group": list(group)}


@pytest.mark.parametrize(
    ("found", "expected"),
    [
        (case(effects=("friction",)), "named"),
        (case(verdict="partly_explained", effects=("friction",)), "named"),
        (case(effects=("friction", "inertia")), "wrong"),
        (case(effects=("inertia",)), "wrong"),
        (case(verdict="ambiguous", effects=("inertia",), group=("inertia", "friction")), "grouped"),
        (case(verdict="ambiguous", effects=("inertia",), group=("inertia", "adhesion")), "silent"),
        (
            case(verdict="ambiguous", effects=("adhesion", "friction"), group=("friction", "x")),
            "wrong",
        ),
        (case(verdict="adequate"), "silent"),
        (case(verdict="unexplained", effects=("inertia",)), "silent"),
        (case(verdict="failed"), "failed"),
        (case(hidden=NOTHING, verdict="adequate"), "silent"),
        (case(hidden=NOTHING, effects=("friction",)), "wrong"),
    ],
)
def test_what_becomes_of_a_pad(found, expected):
    assert outcome(found) == expected


def test_rows_count_every_pad_once_with_bounds_of_the_right_verdict():
    cases = [case(effects=("friction",))] * 3 + [case(verdict="adequate", share=0.04)]
    cases += [case(hidden=NOTHING, verdict="adequate", share=0.0)] * 2
    nothing, friction = rows(cases, (NOTHING, "inertia", "friction"))
    assert (friction.pads, friction.named, friction.silent) == (4, 3, 1)
    assert friction.share == 0.06
    # Clopper and Pearson: of all hits in n the lower bound is 0.025^(1/n)
    assert nothing.bounds == pytest.approx((0.025**0.5, 1.0))


def pretend(self, study):
    name, number = study
    found = {"plan": self.key, "index": f"{name} {number}", "probability": 0.9}
    return found | case(hidden=name, effects=() if name == NOTHING else (name,))


def test_the_command_counts_and_goes_on_where_it_was(tmp_path, monkeypatch):
    monkeypatch.setattr(Benchmark, "run", pretend)
    monkeypatch.setattr(store, "code_digest", lambda: "c")  # to parse the package takes 2 s
    words = ("benchmark", "--effects", "friction,inertia", "-o", tmp_path, "--each")
    status, out, err = call(*words, "1", "--json")
    assert (status, err) == (0, "")
    assert json.loads(out) == json.loads((tmp_path / "benchmark.json").read_text())
    monkeypatch.setattr(Benchmark, "run", lambda self, study: pretend(self, (*study[:1], 1)))
    status, out, err = call(*words, "2")  # a second pad of each, by another function
    assert (status, err) == (0, "")
    read = json.loads((tmp_path / "benchmark.json").read_text())
    assert [row["effect"] for row in read["effects"]] == [NOTHING, "friction", "inertia"]
    assert {row["pads"] for row in read["effects"]} == {2}
    assert "friction" in out
    assert [one["index"] for one in read["cases"]] == [
        f"{name} {number}" for number in (0, 1) for name in (NOTHING, "friction", "inertia")
    ]
