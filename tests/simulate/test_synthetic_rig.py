"""Whole tests and studies: what is measured, when, and that it can be repeated."""

import gzip
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from qlvbayes.io.checks import InputError
from qlvbayes.io.data import read_measurements
from qlvbayes.simulate import (
    HIDDEN,
    NOISES,
    PAPER_RATES,
    TABLE_1,
    Pad,
    Platen,
    paper_protocol,
    record_study,
    simulate_file,
    simulate_study,
    simulate_test,
    specimens_of,
    write_csv,
)

PADS_CSV = Path(__file__).parents[2] / "data" / "pads.csv"
COMMAND = "qlvbayes simulate --pads A,B,C --max-rows 500 --seed 2011 -o data/pads.csv"
CORRELATED = NOISES["correlated"]


def numbers(path):
    return pd.read_csv(path, comment="#")


@pytest.fixture(scope="module")
def pad_a():
    return simulate_study({"A": TABLE_1["A"]}, PAPER_RATES, CORRELATED, 2011, 500)


def test_a_record_starts_with_contact_and_spans_the_program_at_1_khz():
    program = paper_protocol(20.0)
    record = simulate_test(TABLE_1["B"], program, NOISES["none"], np.random.default_rng(0))
    assert (record.time[0], record.displacement[0], record.force[0]) == (0.0, 0.0, 0.0)
    assert np.allclose(np.diff(record.time), 0.001)
    assert 0 <= Platen(program).duration - record.time[-1] < 0.001
    assert np.abs(record.displacement - record.true_displacement).max() <= 0.0005 + 1e-12
    assert abs(record.time.size - 1000 * Platen(program).duration) <= 1


def test_tests_follow_after_two_minutes_and_thinning_changes_no_sample_that_stays(pad_a):
    assert [t.name for t in pad_a] == ["A-0.1", "A-1", "A-10", "A-20", "A-30", "A-100"]
    lengths = [Platen(paper_protocol(rate)).duration for rate in PAPER_RATES]
    assert pad_a[0].start_s == 0.0
    rests = np.diff([t.start_s for t in pad_a]) - lengths[:-1]
    assert rests == pytest.approx(120.0)
    assert max(test.record.time.size for test in pad_a) <= 500
    full = simulate_study({"A": TABLE_1["A"]}, PAPER_RATES[-2:], CORRELATED, 2011)
    for thin, whole in zip(pad_a[-2:], full, strict=True):
        places = np.searchsorted(whole.record.time, thin.record.time)
        for field in ("time", "displacement", "force", "true_displacement", "true_force"):
            kept = getattr(thin.record, field)
            assert np.abs(kept - getattr(whole.record, field)[places]).max() < 1e-12
    few = simulate_study({p: TABLE_1[p] for p in "BA"}, (20.0, 1.0), CORRELATED, 2011, 500)
    before = {test.name: test.record.force for test in pad_a}
    for test in few:
        if test.pad == "A":
            assert np.array_equal(test.record.force, before[test.name])


def test_noise_of_different_tests_is_independent():
    pads = {"A": TABLE_1["A"], "B": TABLE_1["B"]}
    tests = simulate_study(pads, (20.0, 30.0), NOISES["white"], 7)
    noise = [(t.record.force - t.record.true_force)[:60_000] for t in tests]
    correlation = np.corrcoef(noise)[np.triu_indices(len(noise), 1)]
    assert np.all(np.abs(correlation) < 5 / np.sqrt(60_000))


def test_a_material_of_ones_own_sees_the_motion_and_the_clock():
    class Ageing:
        def force(self, platen, times):
            fresh = Pad(TABLE_1["B"]).force(platen, times)
            return fresh * np.exp(-0.01 * (platen.start_s + times))

    programs = {"first": paper_protocol(20.0), "second": paper_protocol(20.0)}
    first, second = record_study({"B": Ageing()}, programs, NOISES["none"], 0)
    weaker = first.record.force * np.exp(-0.01 * second.start_s)
    assert second.record.force == pytest.approx(weaker, abs=1e-14)


def test_a_csv_comes_back_to_the_last_written_digit(tmp_path, pad_a):
    path = tmp_path / "pads.csv"
    write_csv(path, pad_a, ["simulated, not measured", "two\nlines"])
    assert path.read_text().startswith("# simulated, not measured\n# two lines\npad,test,")
    table = numbers(path)
    assert list(table) == ["pad", "test", "start_s", "time_s", "displacement_mm", "force_N"]
    for test in pad_a:
        rows = table[table["test"] == test.name]
        assert rows["time_s"].to_numpy() == pytest.approx(test.record.time, abs=0.51e-4)
        assert rows["displacement_mm"].to_numpy() == pytest.approx(
            test.record.displacement, abs=1e-12
        )
        assert rows["force_N"].to_numpy() == pytest.approx(test.record.force, abs=0.51e-5)
        assert rows["start_s"].to_numpy() == pytest.approx(test.start_s, abs=0.51e-4)


def test_the_same_command_writes_the_same_bytes(tmp_path):
    arguments = ({"B": TABLE_1["B"]}, (20.0, 100.0), CORRELATED, 4, 200, "qlvbayes simulate")
    for name in ("one.csv", "two.csv", "one.csv.gz", "two.csv.gz"):
        simulate_file(tmp_path / name, *arguments)
    plain = (tmp_path / "one.csv").read_bytes()
    assert (tmp_path / "two.csv").read_bytes() == plain
    packed = (tmp_path / "one.csv.gz").read_bytes()
    assert (tmp_path / "two.csv.gz").read_bytes() == packed
    assert gzip.decompress(packed) == plain
    assert len(list(tmp_path.iterdir())) == 4


def test_a_file_that_cannot_be_written_leaves_nothing_behind(tmp_path, pad_a):
    (tmp_path / "pads.csv").mkdir()
    with pytest.raises(InputError, match="cannot be written"):
        write_csv(tmp_path / "pads.csv", pad_a, [])
    with pytest.raises(InputError, match="cannot be written"):
        write_csv(tmp_path / "nowhere" / "pads.csv", pad_a, [])
    assert [p.name for p in tmp_path.iterdir()] == ["pads.csv"]


def test_impossible_settings_and_times_too_close_for_the_file_are_refused(tmp_path):
    with pytest.raises(InputError, match="seed"):
        simulate_study({"A": TABLE_1["A"]}, (20.0,), CORRELATED, -1)
    with pytest.raises(InputError, match="sample rate"):
        simulate_test(TABLE_1["A"], paper_protocol(20.0), CORRELATED, np.random.default_rng(0), 0)
    record = simulate_study({"A": TABLE_1["A"]}, (100.0,), CORRELATED, 0, 100)[0]
    record.record.time[1] = record.record.time[0] + 1e-6
    with pytest.raises(InputError, match="closer than"):
        write_csv(tmp_path / "pads.csv", [record], [])
    hidden, of = [HIDDEN["viscous_drag"](eta=0.01)], ({"B": TABLE_1["B"]}, (20.0,), CORRELATED)
    with pytest.raises(InputError, match="of the plain pad only"):
        simulate_file(tmp_path / "x.csv", *of, 0, 200, "", hidden, loads=(1.0,))


def test_the_data_file_says_what_it_is_and_can_be_made_again(tmp_path, pad_a):
    heading = [line for line in PADS_CSV.read_text().splitlines() if line.startswith("#")]
    assert heading[0].startswith("# simulated, not measured")
    assert f"# command: {COMMAND}" in heading
    assert "seed 2011" in heading[2]
    assert [line.split(":")[0] for line in heading[3:]] == ["# pad A", "# pad B", "# pad C"]
    table = numbers(PADS_CSV)
    assert table.groupby("test").size().max() <= 500
    assert table["test"].nunique() == 18
    write_csv(tmp_path / "again.csv", pad_a, [])
    again = numbers(tmp_path / "again.csv")
    kept = table[table["pad"] == "A"]
    exact = ["pad", "test", "start_s", "time_s", "displacement_mm"]
    assert kept[exact].equals(again[exact])
    # Another build of the solver may round the last digit of a force the other way.
    assert np.abs(kept["force_N"] - again["force_N"]).max() < 1.01e-5


def test_a_file_of_several_kinds_says_which_and_what_was_prescribed(tmp_path):
    pads, groups = specimens_of(["finger:1", "homogeneous"], np.random.default_rng(0))
    path = tmp_path / "hands.csv"
    simulate_file(
        path, pads, (20.0,), CORRELATED, 0, 200, "qlvbayes simulate", loads=(0.5,), groups=groups
    )
    study = read_measurements(path)
    assert [pad.fluid for pad in study.pads] == ["finger", None]
    for pad in study.pads:
        press, creep = pad.tests
        assert (press.control, creep.control) == ("displacement", "force")
        assert creep.start_s == pytest.approx(press.start_s + press.time[-1] + 120.0, abs=1e-3)
    heading = path.read_text().splitlines()[0]
    assert "pressed to 1.6 mm" in heading
    assert "loads put on in 0.1 s" in heading
