"""Load cells that say nothing of what moves, and names in a Japanese machine's letters."""

import numpy as np
import pytest
from support.machine_files import pressed

import qlvbayes as q
from qlvbayes.io.checks import InputError
from qlvbayes.io.conversion import convert
from qlvbayes.io.data import read_measurements
from qlvbayes.io.text import decoded


@pytest.mark.parametrize("names", ["time_s,displacement_mm,force_N", "Time (s),Weg (mm),Kraft (N)"])
def test_a_constant_force_while_the_platen_goes_and_returns_is_of_a_dead_cell(names, tmp_path):
    test = pressed(0.0, hold=1.0, rate=50.0)
    way = np.concatenate([test.way, test.way[::-1]])
    rows = (f"{0.02 * k:.2f},{x:.5f},0.000118" for k, x in enumerate(way))
    path = tmp_path / "dead.csv"
    path.write_text("\n".join([names, *rows]) + "\n")
    with pytest.raises(InputError, match=r"force|check the channels"):
        read_measurements(path)


def test_a_japanese_machine_names_its_columns(tmp_path):
    test = pressed(0.0, hold=1.0, rate=50.0)
    rows = zip(0.02 * np.arange(test.way.size), test.way, test.load, strict=True)
    lines = [
        "時間 (sec),ストローク (mm),試験力 (N)",
        *(f"{t:.2f},{x:.5f},{f:.5f}" for t, x, f in rows),
    ]
    path = tmp_path / "shimadzu.csv"
    path.write_bytes("\r\n".join(lines).encode("cp932"))
    (found,) = convert([path]).tests
    assert "ストローク" in " ".join(found.findings)
    np.testing.assert_allclose(found.force, test.load, atol=1e-5)
    german = "Prüfung ‚erst‘ und ‚dann‘ für Öl, ƒ = 3 µm".encode("cp1252")
    assert decoded(german) == german.decode("cp1252")


def written(path, header, *columns):
    """A table of columns of cells, below a header."""
    path.write_text("\n".join([header, *(";".join(row) for row in zip(*columns, strict=True))]))
    return path


CLOCKS = {
    "log10(t/s);Weg (mm);Kraft (N)": lambda t: f"{np.log10(t):.9f}",
    "ln(Zeit (s));Weg (mm);Kraft (N)": lambda t: f"{np.log(t):.9f}",
    "Heure;Course (mm);Effort (N)": lambda t: f"09:12:{t:09.6f}",
    "Time;Extension (mm);Load (N)": lambda t: (
        f"{12 if t < 1 else 1}:{59 if t < 1 else 0:02}:{59 + t if t < 1 else t - 1:09.6f} PM"
    ),
}


@pytest.mark.parametrize("header", CLOCKS)
def test_a_time_is_a_logarithm_or_a_clock_of_the_day(header, tmp_path):
    test = pressed(0.0, hold=1.0, rate=50.0)
    time = 0.25 + 0.02 * np.arange(test.way.size)
    cells = ([f"{x:.5f}" for x in one] for one in (test.way, test.load))
    (found,) = convert(
        [written(tmp_path / "a.csv", header, map(CLOCKS[header], time), *cells)]
    ).tests
    np.testing.assert_allclose(found.time, time - time[0], atol=2e-6)
    np.testing.assert_allclose(found.force, test.load, atol=1e-5)


def test_channels_with_clocks_of_their_own_have_as_many_rows_as_each_was_read(tmp_path):
    """The displacement is read at 20 Hz, the force at 50 Hz: no reading of either is dropped."""
    test = pressed(0.0, hold=3.0, rate=100.0)
    rare, often = test.time[::5], test.time[::2]
    blank = [""] * (often.size - rare.size)
    (found,) = convert([
        written(
            tmp_path / "daq.csv", "t_disp (s);disp (mm);t_force (s);force (N)",
            [*(f"{t:.3f}" for t in rare), *blank], [*(f"{x:.5f}" for x in test.way[::5]), *blank],
            [f"{t:.3f}" for t in often], [f"{f:.5f}" for f in test.load[::2]],
        )
    ]).tests  # fmt: skip
    assert found.time[-1] == pytest.approx(rare[-1], abs=0.021)
    near = np.interp(found.time, test.time, test.way)
    np.testing.assert_allclose(found.displacement, near, atol=0.06)


def test_a_study_is_read_from_several_files_of_a_machine_or_their_folder(tmp_path):
    for k in range(2):
        test = pressed(0.0, hold=1.0, rate=50.0, seed=k)
        rows = zip(0.02 * np.arange(test.way.size), test.way, test.load, strict=True)
        lines = ["Zeit (s);Weg (mm);Kraft (N)", *(f"{t:.2f};{x:.5f};{f:.5f}" for t, x, f in rows)]
        (tmp_path / f"run{k}.txt").write_text("\n".join(lines))
    for where in (tmp_path, sorted(tmp_path.iterdir())):
        (pad,) = q.read_study(where).pads
        assert [test.name for test in pad.tests] == ["run0", "run1"]
