"""A study read from a file is what was measured, in our units."""

import gzip
import hashlib
import io
import subprocess
import sys
import tempfile
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from qlvbayes.io.checks import InputError
from qlvbayes.io.data import read_measurements
from qlvbayes.io.reading.csvtext import blocks
from qlvbayes.io.reading.noreading import no_readings
from qlvbayes.io.reading.testchecks import wrong_signs
from qlvbayes.io.units import PAD, SAME, STRAIN, SUFFIXES, UnitSystem, column_name

REAL = Path(__file__).parents[3] / "shared" / "real"


def ramp(n=20, step=0.05):
    """Time, displacement and force of one ramp-and-hold, n samples."""
    time = step * np.arange(n)
    displacement = np.minimum(time, 0.5 * time[-1]) * 2.0
    return time, displacement, 0.4 * np.expm1(0.5 * displacement)


def rows(prefix="", suffix="", n=20, sep=","):
    return "".join(
        prefix + sep.join(f"{x:.6f}" for x in row) + suffix + "\n"
        for row in zip(*ramp(n), strict=True)
    )


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


def same_as_plain(study):
    test = only_test(study)
    for got, wanted in zip((test.time, test.displacement, test.force), ramp(), strict=True):
        np.testing.assert_allclose(got, wanted, rtol=0, atol=5e-7)


def test_three_columns_are_enough(tmp_path):
    path = write(tmp_path, PLAIN)
    study = read_measurements(path)
    test = only_test(study)
    same_as_plain(study)
    assert (test.pad, test.name, test.role, test.rate, test.start_s) == (
        "pad",
        "test",
        None,
        None,
        0.0,
    )
    assert test.force_sd is None
    assert (study.units, study.notices, study.source) == (PAD, (), str(path))
    assert study.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()


def test_values_are_the_nearest_floats_to_the_text(tmp_path):
    # Differences in the last place would not average out over a million samples.
    values = np.random.default_rng(1).random((500, 2))
    text = "".join(f"{i},{a!r},{b!r}\n" for i, (a, b) in enumerate(values.tolist()))
    test = only_test(read_measurements(write(tmp_path, f"{HEADER}\n{text}")))
    np.testing.assert_allclose(test.force, values[:, 1], rtol=3e-16, atol=0)


def test_arrays_are_read_only(tmp_path):
    test = only_test(read_measurements(write(tmp_path, PLAIN)))
    with pytest.raises(ValueError, match="read-only"):
        test.force[0] = 1.0


@pytest.mark.parametrize(
    "content",
    [
        "\ufeff" + PLAIN,
        PLAIN.replace("\n", "\r\n"),
        PLAIN.replace("\n", "\r"),
        PLAIN.rstrip("\n"),
        f'# simulated, "seed 3\n#\n{PLAIN}',
        PLAIN.replace("\n", "\n# remark, with, commas\n\n  \n"),
        '"time_s","displacement_mm","force_N"\n' + rows('"', '"', sep='","'),
        PLAIN.replace(",", ", "),
        f"Time_s,Displacement_mm,Force_N\n{rows()}",
        "force_N,time_s,displacement_mm\n"
        + "".join(f"{f:.6f},{t:.6f},{d:.6f}\n" for t, d, f in zip(*ramp(), strict=True)),
    ],
    ids=[
        "mark",
        "crlf",
        "cr",
        "no-last-end",
        "heading",
        "comments",
        "quoted",
        "spaces",
        "capitals",
        "order",
    ],
)
def test_ways_of_writing_the_same_rows(tmp_path, content):
    study = read_measurements(write(tmp_path, content))
    same_as_plain(study)
    assert study.notices == ()


@pytest.mark.parametrize(
    ("content", "notice"),
    [
        (PLAIN.replace(",", ";"), "semicolon-separated values with decimal point"),
        (
            PLAIN.replace(",", ";").replace(".", ","),
            "semicolon-separated values with decimal comma",
        ),
        (PLAIN.replace(",", "\t"), "tab-separated values with decimal point"),
        (PLAIN.replace(",", "\t").replace(".", ","), "tab-separated values with decimal comma"),
        (
            f"{HEADER}\n" + rows("'", "'", sep="','").replace("'", '"').replace(".", "#"),
            "comma-separated values with decimal comma",
        ),
    ],
)
def test_other_dialects_are_read_right_and_noticed(tmp_path, content, notice):
    study = read_measurements(write(tmp_path, content.replace("#", ",")))
    same_as_plain(study)
    assert study.notices == (f"read as {notice}",)


def test_gzip_gives_the_same_study(tmp_path):
    path = write(tmp_path, gzip.compress(PLAIN.encode()), "pads.csv.gz")
    same_as_plain(read_measurements(path))


def test_extra_columns_are_named_once_and_may_hold_anything(tmp_path):
    text = f"{HEADER},operator,temperature_C,force_raw\n" + rows(suffix=",Zoë,,n/a")
    study = read_measurements(write(tmp_path, text))
    same_as_plain(study)
    assert study.notices == ("columns not used: operator, temperature_C, force_raw",)


def test_pads_and_tests_keep_the_order_of_the_file(tmp_path):
    names = [("B", "fast"), ("A", "slow"), ("B", "slow"), ("A", "fast")]
    text = "pad,test,time_s,displacement_mm,force_N\n"
    text += "".join(rows(f"{pad},{test},") for pad, test in names)
    study = read_measurements(write(tmp_path, text))
    assert [(pad.name, [test.name for test in pad.tests]) for pad in study.pads] == [
        ("B", ["fast", "slow"]),
        ("A", ["slow", "fast"]),
    ]
    assert study.pad("A").tests[0].pad == "A"


def test_numeric_names_stay_as_written(tmp_path):
    text = f"pad,test,{HEADER}\n" + rows("007,1,") + rows("007,01,") + rows("7,1.0,")
    study = read_measurements(write(tmp_path, text))
    assert [pad.name for pad in study.pads] == ["007", "7"]
    assert [test.name for test in study.pad("007").tests] == ["1", "01"]


def test_quoted_names_may_hold_separators(tmp_path):
    study = read_measurements(write(tmp_path, f"pad,{HEADER}\n" + rows('"gel, 5 ""wt"" %",')))
    assert study.pads[0].name == 'gel, 5 "wt" %'


def test_an_unknown_pad_is_refused_with_the_known_ones(tmp_path):
    study = read_measurements(write(tmp_path, f"pad,{HEADER}\n" + rows("oil,") + rows("glycerin,")))
    with pytest.raises(InputError, match=r"pads\.csv: no pad 'air'; name one of: oil, glycerin"):
        study.pad("air")


def test_without_start_tests_of_a_pad_follow_one_another(tmp_path):
    text = f"pad,test,{HEADER}\n" + rows("A,1,") + rows("B,1,") + rows("A,2,", n=40) + rows("A,3,")
    study = read_measurements(write(tmp_path, text))
    starts = [test.start_s for test in study.pad("A").tests]
    np.testing.assert_allclose(starts, [0.0, 0.95, 0.95 + 1.95], rtol=1e-15)
    assert study.pad("B").tests[0].start_s == 0.0


def test_declared_start_is_kept_and_the_next_test_follows_it(tmp_path):
    text = f"test,start_min,{HEADER}\n" + rows("a,2,") + rows("b,,") + rows("c,10,")
    tests = read_measurements(write(tmp_path, text)).pads[0].tests
    np.testing.assert_allclose([test.start_s for test in tests], [120.0, 120.95, 600.0])


def test_role_and_rate_are_read_and_may_be_empty(tmp_path):
    text = f"test,role,rate_mm_s,{HEADER}\n"
    text += rows("a,fit,20,") + rows("b,validate,0.1,") + rows("c,,,")
    tests = read_measurements(write(tmp_path, text)).pads[0].tests
    assert [(test.role, test.rate) for test in tests] == [
        ("fit", 20.0),
        ("validate", 0.1),
        (None, None),
    ]


def test_declared_numbers_take_the_decimal_comma_too(tmp_path):
    text = f"rate_mm_s,start_s,{HEADER}\n".replace(",", ";")
    text += rows("0.5;1.5;", sep=";").replace(".", ",")
    test = only_test(read_measurements(write(tmp_path, text)))
    assert (test.rate, test.start_s) == (0.5, 1.5)


def test_a_test_in_two_places_is_one_if_its_time_goes_on(tmp_path):
    lines = rows().splitlines(keepends=True)
    text = f"pad,{HEADER}\n" + "".join(f"A,{line}B,{line}" for line in lines)
    study = read_measurements(write(tmp_path, text))
    for pad in study.pads:
        np.testing.assert_allclose(pad.tests[0].time, ramp()[0], atol=1e-6)
        np.testing.assert_allclose(pad.tests[0].force, ramp()[2], atol=1e-6)


def test_strain_and_stress_have_their_own_units(tmp_path):
    text = "time_ms,strain,stress_Pa,stress_sd_Pa,rate_1_s\n" + rows(suffix=",50,0.2")
    study = read_measurements(write(tmp_path, text))
    test = only_test(study)
    assert study.units == study.pads[0].units == UnitSystem("1", "Pa")
    np.testing.assert_allclose(test.time, ramp()[0] / 1e3, atol=1e-9)
    np.testing.assert_allclose(test.force, ramp()[2], atol=1e-6)
    np.testing.assert_allclose(test.force_sd, 50.0, rtol=1e-15)
    assert test.rate == 0.2


def test_micro_may_be_written_in_greek(tmp_path):
    study = read_measurements(write(tmp_path, PLAIN.replace("displacement_mm", "displacement_µm")))
    assert study.units.displacement == "um"
    np.testing.assert_allclose(only_test(study).displacement, ramp()[1], atol=1e-6)


def test_columns_of_other_units_are_converted_to_that_of_displacement_or_force(tmp_path):
    header = "time_s,displacement_um,force_mN,force_sd_N,rate_mm_s"
    study = read_measurements(write(tmp_path, f"{header}\n{rows(suffix=',0.002,0.5')}"))
    test = only_test(study)
    assert asdict(study.units) == {"displacement": "um", "force": "mN"}
    np.testing.assert_allclose(test.force, ramp()[2], atol=1e-6)
    np.testing.assert_allclose(test.force_sd, 2.0, rtol=1e-15)
    assert test.rate == 500.0


def test_force_may_be_negative_where_the_pad_is_pulled_or_untared(tmp_path):
    time, displacement, force = ramp(200)
    for tested in (force - 5.0, np.where(time > 5.0, force - 1.5 * force.max(), force)):
        text = "".join(f"{t},{d},{f}\n" for t, d, f in zip(time, displacement, tested, strict=True))
        assert only_test(read_measurements(write(tmp_path, f"{HEADER}\n{text}"))).force.min() < 0


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


@pytest.mark.skipif(not REAL.is_dir(), reason="the measurements are not here")
def test_adhesive_in_shear():
    study = read_measurements(REAL / "adhesive_shear.csv")
    sizes = {pad.name: [test.time.size for test in pad.tests] for pad in study.pads}
    assert sizes == {"stairs": [432, 370, 370, 370], "updown": [590]}
    assert [test.role for test in study.pad("stairs").tests] == [
        "validate",
        "validate",
        "fit",
        "validate",
    ]
    assert study.units == PAD
    assert study.pad("updown").tests[0].force.max() == 8.86436


@pytest.mark.skipif(not REAL.is_dir(), reason="the measurements are not here")
def test_muscle_with_measured_standard_deviation():
    study = read_measurements(REAL / "muscle_ramps.csv")
    assert [pad.name for pad in study.pads] == ["relaxed", "calcium", "mavacamten-calcium"]
    assert [sum(test.time.size for test in pad.tests) for pad in study.pads] == [416, 400, 400]
    assert study.units == STRAIN
    tests = [test for pad in study.pads for test in pad.tests]
    assert all(test.force_sd is not None and test.force_sd.min() > 0 for test in tests)
    assert min(test.force.min() for test in tests) < 0  # kept as measured
    assert study.pad("calcium").tests[2].start_s == 719.002


# Round trip -----------------------------------------------------------------------------------

numbers = st.floats(min_value=-1e6, max_value=1e6, allow_subnormal=False)


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
    assume(not no_readings(force).rows.any())
    force[0], force[-1] = 0.5, 2.0  # not constant
    sd = np.array(draw(st.lists(st.floats(1e-6, 10.0), min_size=size, max_size=size)))
    return np.cumsum(steps), grows, force, sd


@settings(deadline=None, max_examples=60)
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


# Size -----------------------------------------------------------------------------------------


def big_text(n):
    block = "".join(
        f"P{i * 4 // n},{i / 1000:.3f},{i % 999 / 500:.4f},{i % 997 / 700:.5f}\n" for i in range(n)
    )
    return f"# simulated\npad,{HEADER}\n{block}"


def test_blocks_do_not_show(tmp_path, monkeypatch):
    text = big_text(5000).replace("\nP2", "\n# remark\n\nP2")
    path = write(tmp_path, text)
    whole = read_measurements(path)
    monkeypatch.setattr(blocks, "__defaults__", (1000,))
    for ours, theirs in zip(whole.pads, read_measurements(path).pads, strict=True):
        assert ours.name == theirs.name
        np.testing.assert_array_equal(ours.tests[0].time, theirs.tests[0].time)
        np.testing.assert_array_equal(ours.tests[0].force, theirs.tests[0].force)
    bad = write(tmp_path, text.replace("P3,4.321,", "P3,4.32l,"), "bad.csv")
    line = 1 + bad.read_text().split("4.32l")[0].count("\n")
    with pytest.raises(InputError, match=rf"bad\.csv, line {line}: time_s"):
        read_measurements(bad)
    back = write(tmp_path, text.replace("P3,4.32", "P3,4.31"), "back.csv")  # ten rows again
    with pytest.raises(InputError, match=rf"back\.csv, line {line - 1}: time_s runs backwards"):
        read_measurements(back)


MEASURE = """
import resource, sys
from qlvbayes.io.reading.csvtext import blocks
from qlvbayes.io.reading.noreading import no_readings
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
