"""A study read from a file is what was measured, in our units."""

import hashlib
import io
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from support.machine_files import pressed

from qlvbayes import read_study
from qlvbayes.io.checks import InputError
from qlvbayes.io.data import read_measurements
from qlvbayes.io.readings import no_readings, wrong_signs
from qlvbayes.io.text import decoded
from qlvbayes.io.units import PAD, SAME, STRAIN, SUFFIXES, column_name
from qlvbayes.laws.elastic.polynomial import HertzPower


def ramp(n=20, step=0.05):
    """Time, displacement and force of one ramp-and-hold, n samples."""
    time = step * np.arange(n)
    displacement = np.minimum(time, 0.5 * time[-1]) * 2.0
    return time, displacement, 0.4 * np.expm1(0.5 * displacement)


def rows(prefix=""):
    lines = (",".join(f"{x:.6f}" for x in row) for row in zip(*ramp(), strict=True))
    return "".join(f"{prefix}{line}\n" for line in lines)


HEADER = "time_s,displacement_mm,force_N"
PLAIN = f"{HEADER}\n{rows()}"


def write(folder, content, name="pads.csv"):
    path = folder / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def only_test(study):
    (pad,) = study.pads
    (test,) = pad.tests
    return test


def test_a_time_that_runs_on_from_test_to_test_is_the_pads_clock(tmp_path):
    def of_tests(*begins):
        lines = [
            f"{name},{begin + t:.6f},{d:.6f},{f:.6f}\n"
            for name, begin in zip("abc", begins, strict=True)
            for t, d, f in zip(*ramp(), strict=True)
        ]
        (pad,) = read_measurements(write(tmp_path, f"test,{HEADER}\n{''.join(lines)}")).pads
        return [(test.start_s, test.start_known) for test in pad.tests]

    assert of_tests(3.0, 64.0, 80.0) == [(0.0, True), (61.0, True), (77.0, True)]
    assert [known for _, known in of_tests(0.0, 64.0, 0.0)] == 3 * [False]  # it restarts once


def test_three_columns_are_enough_and_values_are_the_nearest_floats_to_the_text(tmp_path):
    path = write(tmp_path, PLAIN)
    study = read_measurements(path)
    test = only_test(study)
    for got, wanted in zip((test.time, test.displacement, test.force), ramp(), strict=True):
        np.testing.assert_allclose(got, wanted, rtol=0, atol=5e-7)
    assert (test.pad, test.name, test.start_s) == ("pad", "test", 0.0)
    assert (test.role, test.rate, test.force_sd) == (None, None, None)
    assert (study.units, study.notices, study.source) == (PAD, (), str(path))
    assert study.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    values = np.random.default_rng(1).random((500, 2))
    text = "".join(f"{i},{a!r},{b!r}\n" for i, (a, b) in enumerate(values.tolist()))
    test = only_test(read_measurements(write(tmp_path, f"{HEADER}\n{text}")))
    np.testing.assert_allclose(test.force, values[:, 1], rtol=3e-16, atol=0)


def test_an_unknown_pad_is_refused_with_the_names_that_are_known(tmp_path):
    study = read_measurements(write(tmp_path, f"pad,{HEADER}\n" + rows("oil,") + rows("glycerin,")))
    with pytest.raises(InputError, match=r"pads\.csv: no pad 'air'; name one of: oil, glycerin"):
        study.pad("air")


def test_signs_in_doubt_pass():
    time, displacement, force = ramp(200)
    relaxing = 1.0 - 0.2 * np.tanh(time)
    creeping = 2.0 + 0.01 * np.tanh(time)  # a soft frame gives way as the force relaxes
    assert wrong_signs(displacement, force) == ()
    assert wrong_signs(creeping, relaxing) == ()
    assert wrong_signs(displacement[::-1].copy(), force[::-1].copy()) == ()
    assert wrong_signs(displacement, -force) == ("force",)
    assert wrong_signs(-displacement, force) == ("displacement",)
    assert wrong_signs(5.0 - displacement, force) == ("displacement",)
    assert wrong_signs(-displacement, -force) == ("displacement", "force")


@st.composite
def written_studies(draw):
    """Text of a random study in random units, and its arrays in its own, by (pad, test)."""
    strain = draw(st.booleans())
    separator, decimal = draw(st.sampled_from([(",", "."), (";", ","), (";", "."), ("\t", ",")]))
    force, sd = ("stress", "stress_sd") if strain else ("force", "force_sd")
    quantities = ["time", "strain" if strain else "displacement", force, sd]
    suffixes = [draw(st.sampled_from(sorted(SUFFIXES[quantity]))) for quantity in quantities]
    names = [column_name(*pair) for pair in zip(quantities, suffixes, strict=True)]
    text = io.StringIO()
    text.write(separator.join(["pad", "test", *names]) + "\n")
    wanted = {}
    for pad in draw(st.lists(st.sampled_from("ABC"), min_size=1, max_size=3, unique=True)):
        for test in range(draw(st.integers(1, 3))):
            columns = draw(columns_of_a_test())
            for row in zip(*(column.tolist() for column in columns), strict=True):
                cells = [repr(value).replace(".", decimal) for value in row]
                text.write(separator.join([pad, str(test), *cells]) + "\n")
            time, sd_unit, force_unit = (SUFFIXES[quantities[k]][suffixes[k]] for k in (0, 3, 2))
            scales = [time, SAME, SAME, sd_unit.over(force_unit)]
            wanted[pad, str(test)] = [
                column * scale.up / scale.down
                for column, scale in zip(columns, scales, strict=True)
            ]
    return text.getvalue(), wanted


@st.composite
def columns_of_a_test(draw):
    size = draw(st.integers(10, 15))
    steps = draw(st.lists(st.floats(1e-3, 10.0), min_size=size, max_size=size))
    grows = np.cumsum(draw(st.lists(st.floats(1e-3, 1.0), min_size=size, max_size=size)))
    # loggers write a row of nines, or a number out of all range, where they have no reading
    force = np.array(draw(st.lists(st.floats(0.0, 8e5), min_size=size, max_size=size)))
    assume(not no_readings(force)[0].any())
    force[0], force[-1] = 0.5, 2.0  # not constant
    sd = np.array(draw(st.lists(st.floats(1e-6, 10.0), min_size=size, max_size=size)))
    return np.cumsum(steps), grows, force, sd


@settings(deadline=None, max_examples=12)
@given(written_studies())
def test_what_is_written_in_any_unit_is_read_back(case):
    text, wanted = case
    with tempfile.TemporaryDirectory() as folder:
        study = read_measurements(write(Path(folder), text))
    tests = {(test.pad, test.name): test for pad in study.pads for test in pad.tests}
    assert tests.keys() == wanted.keys()
    for key, columns in wanted.items():
        test = tests[key]
        got = (test.time, test.displacement, test.force, test.force_sd)
        for array, column in zip(got, columns, strict=True):
            np.testing.assert_allclose(array, column, rtol=1e-12, atol=0)


def big_text(n):
    block = "".join(
        f"P{i * 4 // n},{i / 1000:.3f},{i % 999 / 500:.4f},{i % 997 / 700:.5f}\n" for i in range(n)
    )
    return f"# simulated\npad,{HEADER}\n{block}"


def test_the_line_of_a_fault_counts_remarks_and_blank_lines(tmp_path):
    text = big_text(5000).replace("\nP2", "\n# remark\n\nP2")
    (_, *_, last) = read_measurements(write(tmp_path, text)).pads
    assert len(last.tests[0].time) == 1250
    bad = write(tmp_path, text.replace("P3,4.321,", "P3,4.32l,"), "bad.csv")
    line = 1 + bad.read_text().split("4.32l")[0].count("\n")
    with pytest.raises(InputError, match=rf"bad\.csv, line {line}: time_s"):
        read_measurements(bad)
    back = write(tmp_path, text.replace("P3,4.32", "P3,4.31"), "back.csv")  # ten rows again
    with pytest.raises(InputError, match=rf"back\.csv, line {line - 1}: time_s runs backwards"):
        read_measurements(back)


MEASURE = """
import resource, sys
from qlvbayes.io.data import read_measurements
peak = lambda: resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
read_measurements(sys.argv[1])
before = peak()
study = read_measurements(sys.argv[2])
print(peak() - before, sum(test.time.size for pad in study.pads for test in pad.tests))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="ru_maxrss is in kilobytes on Linux only")
@pytest.mark.slow
def test_a_million_rows_need_little_more_memory_than_their_numbers(tmp_path):
    small, big = write(tmp_path, big_text(200_000), "small.csv"), write(tmp_path, big_text(10**6))
    command = [sys.executable, "-c", MEASURE, str(small), str(big)]
    out = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    grown, size = map(int, out.split())
    assert size == 10**6
    assert grown < 3 * 24 * size


def test_units_follow_from_displacement_and_force_and_columns_carry_suffixes():
    units = (PAD.displacement, PAD.force, *map(PAD.of, ("stiffness", "exponent", "rate", "speed")))
    assert units == ("mm", "N", "N/mm", "1/mm", "1/s", "mm/s")
    assert not PAD.bonded_default
    assert PAD.of(HertzPower.units["m"]) == "N/mm^n"
    assert STRAIN.of(HertzPower.units["m"]) == "kPa"
    units = (STRAIN.displacement, STRAIN.force, STRAIN.stiffness, STRAIN.of("exponent"))
    assert units == ("1", "kPa", "kPa", "1")
    assert (STRAIN.of("rate"), STRAIN.speed) == ("1/s", "1/s")
    assert STRAIN.bonded_default


@pytest.mark.parametrize(
    ("quantity", "suffix", "ours"),
    [("time", "ms", 0.001), ("time", "min", 60.0), ("displacement", "um", 0.001),
     ("displacement", "nm", 1e-6), ("displacement", "m", 1000.0), ("force", "mN", 0.001),
     ("force_sd", "uN", 1e-6), ("force", "nN", 1e-9), ("stress", "MPa", 1000.0),
     ("stress_sd", "Pa", 0.001), ("start", "min", 60.0), ("strain", "", 1.0)],
)  # fmt: skip
def test_one_of_a_unit_is_the_nearest_float_in_ours(quantity, suffix, ours):
    values = np.array([1.0])
    SUFFIXES[quantity][suffix].convert(values)
    assert values[0] == ours


def test_a_study_is_read_from_several_files_of_a_machine_or_their_folder(tmp_path):
    for k in range(2):
        test = pressed(0.0, hold=1.0, rate=50.0, seed=k)
        rows = zip(0.02 * np.arange(test.way.size), test.way, test.load, strict=True)
        lines = ["Zeit (s);Weg (mm);Kraft (N)", *(f"{t:.2f};{x:.5f};{f:.5f}" for t, x, f in rows)]
        (tmp_path / f"run{k}.txt").write_text("\n".join(lines))
    for where in (tmp_path, sorted(tmp_path.iterdir())):
        (pad,) = read_study(where).pads
        assert [test.name for test in pad.tests] == ["run0", "run1"]


def test_a_european_text_is_not_taken_for_a_japanese_one():
    german = "Prüfung ‚erst‘ und ‚dann‘ für Öl, ƒ = 3 µm".encode("cp1252")
    assert decoded(german) == german.decode("cp1252")
