"""Every file that cannot be used is refused in one line with the place and the remedy."""

import gzip
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from qlvbayes.io.checks import InputError
from qlvbayes.io.data import read_measurements, read_tidy

HEADER = "time_s,displacement_mm,force_N"
LINES = [
    f"{k / 100:.2f},{min(k, 12) / 10:.2f},{0.4 * np.expm1(min(k, 12) / 20):.5f}" for k in range(20)
]


def text(*lines, header=HEADER):
    return "\n".join([header, *lines]) + "\n"


def test_the_line_is_right_deep_in_a_compressed_file(tmp_path):
    rows = [f"{k / 1000:.3f},{k % 7},{k % 5}" for k in range(60_000)]
    rows[45_678] = "45.678,0.1,O.2"
    path = tmp_path / "pads.csv.gz"
    path.write_bytes(gzip.compress(("# simulated\n" + text(*rows)).encode(), compresslevel=1))
    with pytest.raises(InputError, match=r"force_N is not a number \('O.2'\)") as caught:
        read_measurements(path)
    found = caught.value
    assert (found.file, found.line) == (str(path), 45_681)
    assert found.remedy == "write a number or delete the row"


def test_a_folder_and_a_file_written_to_while_it_is_read_are_told(tmp_path, monkeypatch):
    with pytest.raises(InputError, match="folder; name the files"):
        read_measurements(tmp_path)
    path = tmp_path / "pads.csv"
    path.write_text(text(*LINES))

    def read_then_grow(file, dialect):
        table = read_tidy(file, dialect)
        with path.open("a") as stream:
            stream.write("0.2,")
        return table

    monkeypatch.setattr("qlvbayes.io.data.read_tidy", read_then_grow)
    with pytest.raises(InputError, match=r"pads\.csv: the file changed .* read; wait until"):
        read_measurements(path)


FULL = text(
    *(f"A,1,fit,20,0,{line}" for line in LINES), header=f"pad,test,role,rate_mm_s,start_s,{HEADER}"
).encode()
PIECES = [b",", b'"', b"\n", b"\r", b"#", b";", b"\t", b"\0", b"\xff", b"nan", b"-", b" ", b"1e999"]


@settings(deadline=None, max_examples=40)
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
