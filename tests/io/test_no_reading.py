"""Check that what is no reading or number is refused, or left out and counted."""

import math
import random
import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from support.machine_files import FIXTURES, of_layout

from qlvbayes.diagnosis.decision import Weight, decide
from qlvbayes.io import apart
from qlvbayes.io.apart import ApartError, read_apart
from qlvbayes.io.checks import InputError
from qlvbayes.io.conversion import convert
from qlvbayes.io.data import read_measurements
from qlvbayes.io.loading import Answers
from qlvbayes.io.readings import no_readings

BROKEN = Path(__file__).parents[3] / "shared" / "records" / "broken"
RECORD = np.concatenate([np.linspace(0.0, 1.2, 40), np.full(40, 1.2)])
TEXTS = [one for one in FIXTURES if not one.needs and one.path.suffix in (".csv", ".txt", ".tra")]
ANSWERS = Answers(sign="none", contact="file")
ENDLESS = 200_000  # cells of a line


def with_values(rows, value, record=RECORD):
    changed = record.copy()
    changed[rows] = value
    return changed


@pytest.mark.parametrize(
    "code",
    [-999.0, 9999.0, -99.0, 99.99, -999.25, -32768.0, 9.9e37, -1e30, 1e160],
)
def test_codes_of_loggers_are_no_readings(code):
    rows, codes = no_readings(with_values([3, 20, 21], code))
    assert np.flatnonzero(rows).tolist() == [3, 20, 21]
    assert codes == f"{code:.12g}"


def test_two_codes_and_what_is_not_finite_are_found_together_and_readings_stay():
    record = with_values([3], -999.0, with_values([9], 9999.0, with_values([12], math.nan)))
    assert np.flatnonzero(no_readings(record)[0]).tolist() == [3, 9, 12]
    assert not no_readings(np.array([0.0, 1.0, 2.0, 999.0]), coded=False)[0].any()  # a clock
    for sound in (
        np.linspace(0.0, -1200.0, 1201),  # passes -999 on its way
        with_values([5], 5.0),  # a spike is no code
        with_values(slice(10, 80), 99.0, np.zeros(80)),  # a step of 99, held
        RECORD,
    ):
        assert not no_readings(sound)[0].any()


def test_a_reader_that_does_not_end_is_ended_and_a_refusal_is_a_line(tmp_path):
    with pytest.raises(ApartError, match="did not end within 0 s"):
        read_apart("hdf5", of_layout("hdf5-a.h5"), limit=1e-3)
    file = tmp_path / "a.mat"
    file.write_bytes(b"MATLAB 5.0 MAT-file" + bytes(200))
    with pytest.raises(InputError, match="cut off or damaged") as caught:
        convert([file])
    assert caught.value.file == str(file)


def test_an_endless_line_takes_no_memory_and_an_endless_field_is_refused(tmp_path):
    lines = of_layout("cellscale-a.csv").read_text().splitlines()
    (tmp_path / "a.csv").write_text("\n".join([*lines[:5], "," * ENDLESS, *lines[5:]]) + "\n")
    tracemalloc.start()
    (test,) = convert([tmp_path / "a.csv"]).tests
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 50 * ENDLESS  # bytes
    assert test.dropped["lines without numbers"] == 1
    (tmp_path / "a.csv").write_text(
        f"pad,time_s,displacement_mm,force_N\n{'x' * 140_000},0,0,0\nB,1,1,1\n"
    )
    with pytest.raises(InputError, match="longer than 120 bytes") as caught:
        read_measurements(tmp_path / "a.csv")
    assert caught.value.line == 2


def refusal(read, file):
    """Return the text of an InputError; any other error ends the test."""
    try:
        read(file)
    except InputError as error:
        return str(error)
    return None


@pytest.mark.slow
@pytest.mark.skipif(not BROKEN.is_dir(), reason="the broken records are not here")
@pytest.mark.parametrize("file", sorted(BROKEN.glob("*.*")), ids=lambda file: file.name)
def test_broken_files_are_read_or_refused(file, monkeypatch):
    monkeypatch.setattr(apart, "TIME_S", 1.0 if file.stem == "hang" else 4.0)
    if file.suffix == ".md":
        return
    for read in (read_measurements, lambda one: convert([one])):
        assert (refusal(read, file) or str(file)).startswith(str(file))


INSERTED = [
    b",", b";", b"\t", b"\n", b'"', b"nan", b"inf", b"1e999", b"-999", b"1e308", b"1e-320", b"",
    b"(mm)", b"[N]", b"\0", b"\xff", b"time", b"1,5", b"=1+1", b"\x1b[2J", b"#",
]  # fmt: skip


def hurt(data, chance):
    """A file with one to four things wrong with it."""
    changed = bytearray(data)
    for _ in range(chance.randrange(1, 5)):
        begin = chance.randrange(len(changed))
        end = min(begin + chance.randrange(0, 30), len(changed))
        what = chance.choice([*INSERTED, bytes(changed[begin:end]) * 5])
        changed[begin:end] = what
        if not changed:
            return b""
    return bytes(changed)


@settings(
    max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(fixture=st.sampled_from(TEXTS), seed=st.integers(0, 2**32))
def test_a_hurt_file_is_read_or_refused(tmp_path, fixture, seed):
    chance = random.Random(seed)
    file = tmp_path / fixture.path.name
    file.write_bytes(hurt(fixture.path.read_bytes(), chance))
    found = []
    said = refusal(lambda one: found.append(convert([one], ANSWERS)), file)
    assert said is None or said.startswith(str(tmp_path))
    assert "cannot be read as" not in (said or "")  # the last resort of `convert`
    for test in (test for one in found for test in one.tests):
        assert np.isfinite(test.displacement).all()
        assert np.isfinite(test.force).all()


LAWS = ("exponential", "prony:2")
NAMED = Weight(LAWS, frozenset({"friction"}), 0.0, 0.01)
PLAIN = Weight(LAWS, frozenset(), -9.0, 0.01)


@pytest.mark.parametrize("log", [math.nan, math.inf, -math.inf])
def test_a_hypothesis_without_a_number_takes_no_part_in_the_decision(log):
    lost = Weight(LAWS, frozenset({"inertia"}), log, math.nan, error=math.inf).made_finite()
    with_it, without = decide([NAMED, PLAIN, lost]), decide([NAMED, PLAIN])
    assert not lost.counts
    assert with_it.inclusion.pop("inertia") == 0.0
    assert replace(with_it, base={}) == replace(without, base={})
