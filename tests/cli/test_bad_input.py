"""Every file that cannot be used is refused in one line with the place and the remedy."""

import gzip
import re
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from qlvbayes.io.checks import InputError
from qlvbayes.io.data import read_measurements
from qlvbayes.io.reading.table import read_table

HEADER = "time_s,displacement_mm,force_N"
LINES = [
    f"{k / 100:.2f},{min(k, 12) / 10:.2f},{0.4 * np.expm1(min(k, 12) / 20):.5f}" for k in range(20)
]


def text(*lines, header=HEADER):
    return "\n".join([header, *lines]) + "\n"


def with_row(k, row, lines=LINES):
    """File whose k-th row, on line k + 2, is another."""
    return text(*lines[:k], row, *lines[k + 1 :])


def each(*cells, header, lines=LINES):
    """Every row with the same further cells."""
    return text(*[",".join([*cells, line]) for line in lines], header=f"{header},{HEADER}")


def scaled(displacement=1, force=1):
    rows = (map(float, line.split(",")) for line in LINES)
    return text(*[f"{t},{d * displacement},{f * force}" for t, d, f in rows])


def refused(tmp_path, content, line, problem, remedy, name="pads.csv"):
    path = tmp_path / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    with pytest.raises(InputError) as caught:
        read_measurements(path)
    message = str(caught.value)
    assert "\n" not in message
    place = f"{path}, line {line}: " if line else f"{path}: "
    assert message.startswith(place)
    complaint, _, advice = message.removeprefix(place).partition("; ")
    assert problem in complaint
    assert remedy in advice


def test_missing_file(tmp_path):
    path = tmp_path / "absent.csv"
    with pytest.raises(InputError, match=rf"^{re.escape(str(path))}: no such file; check the path"):
        read_measurements(path)


def test_folder(tmp_path):
    with pytest.raises(
        InputError, match=rf"^{re.escape(str(tmp_path))}: .* folder; name the files"
    ):
        read_measurements(tmp_path)


ZIPPED = gzip.compress(text(*LINES).encode())

FILES = {
    "empty": (b"", None, "empty", "export", "pads.csv"),
    "empty gzip": (gzip.compress(b""), None, "empty", "export", "pads.csv.gz"),
    "zero bytes named gzip": (b"", None, "empty", "export", "pads.csv.gz"),
    "blank": ("\n \n", None, "empty", "export", "pads.csv"),
    "comments only": ("# simulated\n# seed 3\n", None, "comments", "export", "pads.csv"),
    "binary": (bytes(range(256)) * 4, None, "binary", "CSV text", "pads.csv"),
    "workbook": (b"PK\x03\x04\x14\x00\x06\x00" + b"\x9a" * 99, None, "binary", "CSV", "pads.csv"),
    "utf-16": (text(*LINES).encode("utf-16"), None, "UTF-16", "as UTF-8", "pads.csv"),
    "utf-16 unmarked": (text(*LINES).encode("utf-16-le"), None, "UTF-16", "UTF-8", "pads.csv"),
    "not gzip": (text(*LINES), None, "not gzip", "rename it to pads.csv", "pads.csv.gz"),
    "cut gzip": (ZIPPED[:-20], None, "cut off", "copy or compress", "pads.csv.gz"),
    "bad gzip": (ZIPPED[:40] + b"\xff" * 40, None, "damaged", "compress", "pads.csv.gz"),
    "secretly gzip": (ZIPPED, None, "gzip", "rename it to pads.csv.gz", "pads.csv"),
    "latin-1": (
        each("gelée", header="pad").encode("latin-1"),
        2,
        "not UTF-8",
        "save the file as UTF-8",
        "pads.csv",
    ),
}


@pytest.mark.parametrize("case", FILES)
def test_files_that_are_no_text(tmp_path, case):
    content, line, problem, remedy, name = FILES[case]
    refused(tmp_path, content, line, problem, remedy, name)


HEADERS = {
    "header only": (HEADER, 1, "no rows", "export"),
    "no header": (LINES[0], 1, "numbers, not column names", "add a header line"),
    "no header, with pad": (f"A,{LINES[0]}", 1, "numbers, not column names", "add a header line"),
    "no force": ("time_s,displacement_mm", 1, "no column for force", "needed are force_N"),
    "what it has": ("time_s,displacement_mm,x", 1, "(the file has: time_s, dis", "force_N"),
    "bracket": ("time_s,displacement_mm,Force [N]", 1, "force", "rename 'Force [N]' to force_N"),
    "bracket mN": ("time_s,displacement_mm,Load (mN)", 1, "force", "'Load (mN)' to force_mN"),
    "brackets": ("Time [s],displacement_mm,Force [N]", 1, "time and force", "'Time [s]' to time_s"),
    "no unit": ("time_s,displacement_mm,force", 1, "'force' has no unit", "rename it to force_N"),
    "unknown unit": (
        "time_s,displacement_mm,force_lbf",
        1,
        "the unit 'lbf' of 'force_lbf' is unknown",
        "rename it to force_N or force_mN",
    ),
    "unknown sd unit": (f"{HEADER},force_sd_lbf", 1, "'lbf'", "rename it to force_sd_N"),
    "start without unit": (f"{HEADER},start", 1, "'start' has no unit", "start_s"),
    "per cent": ("time_s,strain_pct,stress_kPa", 1, "'pct'", "rename it to strain"),
    "same twice": (f"{HEADER},force_N", 1, "two columns for force", "delete one"),
    "two units": (f"time_ms,{HEADER}", 1, "'time_ms' and 'time_s'", "delete one"),
    "two pads": (f"pad,{HEADER},Pad", 1, "two columns for pad", "delete one"),
    "displacement and strain": (f"{HEADER},strain", 1, "'displacement_mm' and 'strain'", "delete"),
    "mixed": ("time_s,displacement_mm,stress_kPa", 1, "does not go with", "strain with stress"),
    "mixed sd": ("time_s,strain,stress_kPa,force_sd_N", 1, "'force_sd_N'", "strain with stress"),
    "rate of strain": (f"{HEADER},rate_1_s", 1, "rate_1_s", "give rate_mm_s"),
    "blanks": (HEADER.replace(",", " "), 1, "unit", "rename"),
    "pipes": (HEADER.replace("time_s", "t").replace(",", "|"), 1, "no column", "by commas"),
    "heading": (f"# simulated\n\n{HEADER},force_N", 3, "two columns", "delete one"),
}


@pytest.mark.parametrize("case", HEADERS)
def test_headers(tmp_path, case):
    header, line, problem, remedy = HEADERS[case]
    rows = [] if case == "header only" else LINES
    refused(tmp_path, text(*rows, header=header), line, problem, remedy)


NUMBER = "write a number or delete the row"
ROWS = {
    "text": (with_row(5, "0.05,abc,0.1"), 7, "displacement_mm is not a number ('abc')", NUMBER),
    "empty cell": (with_row(5, "0.05,,0.1"), 7, "displacement_mm is empty", NUMBER),
    "nan": (with_row(5, "0.05,0.5,NaN"), 7, "force_N is missing ('NaN')", NUMBER),
    "na": (with_row(0, "NA,0.5,0.1"), 2, "time_s is missing ('NA')", NUMBER),
    "inf": (with_row(19, "0.19,0.5,inf"), 21, "force_N is not finite ('inf')", NUMBER),
    "overflow": (with_row(5, "0.05,0.5,1e999"), 7, "force_N is not finite", NUMBER),
    "true": (
        text(*[line.rsplit(",", 1)[0] + ",True" for line in LINES]),
        2,
        "force_N is not a number ('True')",
        NUMBER,
    ),
    "underscore": (with_row(5, "0.05,1_0,0.1"), 7, "not a number ('1_0')", NUMBER),
    "hexadecimal": (with_row(5, "0.05,0x1,0.1"), 7, "not a number ('0x1')", NUMBER),
    "unit in cell": (with_row(5, "0.05,0.5,0.1 N"), 7, "not a number ('0.1 N')", NUMBER),
    "thousands": (with_row(5, '0.05,"1,000",0.1'), 7, "decimal comma", "write '.'"),
    "point among commas": (
        text(*LINES[:5], "0.05,0.5,0.1", *LINES[6:])
        .replace(",", ";")
        .replace(".", ",")
        .replace("0,05;0,5;0,1", "0,05;0,5;0.1"),
        7,
        "decimal point",
        "write ','",
    ),
    "short": (with_row(5, "0.05,0.5"), 7, "2 fields and the header 3", "complete or delete"),
    "long": (with_row(5, "0.05,0.5,0.1,9"), 7, "4 fields and the header 3", "delete the row"),
    "short and long": (
        text(*LINES[:5], "0.05,0.5", "0.06,0.6,0.1,7", *LINES[7:]),
        7,
        "2 fields",
        "complete",
    ),
    "cut last line": (text(*LINES) + "0.2", 22, "1 field and the header 3", "delete the row"),
    "commas only": (text(*LINES) + ",,\n", 22, "time_s is empty", NUMBER),
    "comments count": (
        "# simulated\n" + text(*LINES[:5], "# remark", "", "0.05,x,0.1"),
        10,
        "displacement_mm is not a number ('x')",
        NUMBER,
    ),
    "first of two": (text(*LINES[:3], "a,0,0", "0.1,0"), 5, "time_s is not a number", NUMBER),
    "crlf": (with_row(5, "0.05,x,0.1").replace("\n", "\r\n"), 7, "displacement_mm", NUMBER),
    "open quote": (with_row(5, '0.05,"0.5,0.1'), 7, "quotation mark", "remove it"),
    "quote inside": (with_row(5, '0.05,0"5",0.1'), 7, "quotation mark", "remove it"),
    "zero byte": (
        with_row(5, "0.05,0.5,0.1").encode() + b"# " + b"x" * 600_000 + b"\n\0\n",
        23,
        "binary",
        "CSV",
    ),
}


@pytest.mark.parametrize("case", ROWS)
def test_rows(tmp_path, case):
    refused(tmp_path, *ROWS[case])


BACK = [*LINES[:10], "0.03,0.9,0.2", *LINES[11:]]
TESTS = {
    "time repeats": (with_row(5, "0.04,0.5,0.1"), 7, "time_s repeats", "delete the repeated row"),
    "time backwards": (with_row(15, "0.10,1,0.1"), 17, "time_s runs backwards", "sort"),
    "restart without test": (text(*LINES, *LINES), 22, "restarts", "add a test column"),
    "restart within pad": (
        each("A", header="pad", lines=LINES * 2),
        22,
        "'A' (0 s after 0.19 s)",
        "add a test column",
    ),
    "restart in test": (
        each("A", "1", header="pad,test", lines=LINES * 2),
        22,
        "restarts",
        "give each test its own name",
    ),
    "test comes back": (
        text(
            *[f"A,{line}" for line in LINES],
            *[f"B,{line}" for line in LINES],
            *[f"A,{line}" for line in LINES],
            header=f"test,{HEADER}",
        ),
        42,
        "restarts in test 'A'",
        "give each test its own name",
    ),
    "three rows": (text(*LINES[:3]), 2, "has 3 rows, at least 10", "delete the test"),
    "three rows in second": (
        text(
            *[f"a,{line}" for line in LINES],
            *[f"b,{line}" for line in LINES[:3]],
            header=f"test,{HEADER}",
        ),
        22,
        "test 'b' of pad 'pad' has 3 rows",
        "add the missing rows",
    ),
    "no motion": (scaled(displacement=0), 2, "displacement_mm never changes", "check the channel"),
    "no force": (scaled(force=0), 2, "force_N never changes", "check the channel"),
    "force upside down": (scaled(force=-1), 2, "force_N of the wrong", "multiply force_N by -1"),
    "displacement upside down": (
        scaled(displacement=-1),
        2,
        "displacement_mm of the wrong sign",
        "multiply displacement_mm by -1",
    ),
    "both upside down": (scaled(-1, -1), 2, "wrong", "displacement_mm and force_N by -1"),
    "sd of nought": (
        text(*[f"{line},{0 if k == 4 else 0.1}" for k, line in enumerate(LINES)]).replace(
            HEADER, f"{HEADER},force_sd_N"
        ),
        6,
        "force_sd_N is not positive (0)",
        "delete the column",
    ),
    "sd empty": (
        text(*[f"{line}," for line in LINES], header=f"{HEADER},force_sd_N"),
        2,
        "force_sd_N is empty",
        NUMBER,
    ),
    "unknown role": (each("train", header="role"), 2, "'train' is unknown", "write fit, validate"),
    "role changes": (
        text(*[f"{'fit' if k < 7 else 'validate'},{x}" for k, x in enumerate(LINES)]).replace(
            HEADER, f"role,{HEADER}"
        ),
        9,
        "role changes from 'fit' to 'validate'",
        "one role",
    ),
    "rate changes": (
        text(*[f"{20 if k < 7 else 21},{x}" for k, x in enumerate(LINES)]).replace(
            HEADER, f"rate_mm_s,{HEADER}"
        ),
        9,
        "rate_mm_s changes from '20' to '21'",
        "one rate_mm_s",
    ),
    "start changes": (
        text(*[f"{0 if k < 7 else 5},{x}" for k, x in enumerate(LINES)]).replace(
            HEADER, f"start_min,{HEADER}"
        ),
        9,
        "start_min changes",
        "one start_min",
    ),
    "rate is text": (
        each("fast", header="rate_mm_s"),
        2,
        "not a number ('fast')",
        "leave it empty",
    ),
    "rate of nought": (each("0", header="rate_mm_s"), 2, "not positive", "without sign"),
    "start is text": (each("noon", header="start_s"), 2, "start_s is not a number", "number"),
    "empty pad": (each("", header="pad"), 2, "pad is empty", "write its name"),
    "empty test": (each(" ", header="test"), 2, "test is empty", "write its name"),
    "pad with slash": (each("../A", header="pad"), 2, "cannot name a folder", "without /"),
}


@pytest.mark.parametrize("case", TESTS)
def test_tests(tmp_path, case):
    refused(tmp_path, *TESTS[case])


def test_the_line_is_right_deep_in_a_compressed_file(tmp_path):
    rows = [f"{k / 1000:.3f},{k % 7},{k % 5}" for k in range(400_000)]
    rows[345_678] = "345.678,0.1,O.2"
    content = gzip.compress(("# simulated\n" + text(*rows)).encode(), compresslevel=1)
    problem = "force_N is not a number ('O.2')"
    refused(tmp_path, content, 345_681, problem, NUMBER, "pads.csv.gz")


def test_a_file_written_to_while_it_is_read_says_so(tmp_path, monkeypatch):
    path = tmp_path / "pads.csv"
    path.write_text(text(*LINES))

    def read_then_grow(file, dialect):
        table = read_table(file, dialect)
        with path.open("a") as stream:
            stream.write("0.2,")
        return table

    monkeypatch.setattr("qlvbayes.io.data.read_table", read_then_grow)
    with pytest.raises(InputError, match=r"pads\.csv: the file changed .* read; wait until"):
        read_measurements(path)


FULL = each("A", "1", "fit", "20", "0", header="pad,test,role,rate_mm_s,start_s").encode()
PIECES = [b",", b'"', b"\n", b"\r", b"#", b";", b"\t", b"\0", b"\xff", b"nan", b"-", b" ", b"1e999"]


@settings(deadline=None, max_examples=300)
@given(
    st.sampled_from([FULL, gzip.compress(FULL)]),
    st.lists(
        st.tuples(st.floats(0, 1), st.integers(0, 40), st.sampled_from(PIECES) | st.binary()),
        min_size=1,
        max_size=4,
    ),
)
def test_damage_gives_a_study_or_one_line_and_nothing_else(content, damages):
    zipped = content[:2] == b"\x1f\x8b"
    for place, removed, put in damages:
        at = int(place * len(content))
        content = content[:at] + put + content[at + removed :]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / ("pads.csv.gz" if zipped else "pads.csv")
        path.write_bytes(content)
        message, pads = None, ()
        try:
            pads = read_measurements(path).pads
        except InputError as error:
            message = str(error)
    if message is not None:
        assert message.startswith(str(path))
        assert "; " in message
        assert "\n" not in message
    for test in (test for pad in pads for test in pad.tests):
        assert np.isfinite([test.time, test.displacement, test.force]).all()
        assert (np.diff(test.time) > 0).all()
