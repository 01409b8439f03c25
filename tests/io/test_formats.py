"""Every layout is known by its own format alone, read right, and damaged without a traceback."""

from dataclasses import replace

import numpy as np
import pytest
from support.machine_files import CORPUS, FIXTURES, LAG, STORED, of_layout, pressed

from qlvbayes.io import binary
from qlvbayes.io.binary import Binary, meaning, of_topics
from qlvbayes.io.checks import InputError
from qlvbayes.io.columns import split_header
from qlvbayes.io.contact import find_contact, find_signs
from qlvbayes.io.conversion import convert
from qlvbayes.io.formats import (
    FORMATS,
    FormatError,
    check_format,
    own_formats,
    recognised,
)
from qlvbayes.io.layouts import BLUEHILL_3
from qlvbayes.io.loading import Answers
from qlvbayes.io.recording import AbstractFormat, UnsureError
from qlvbayes.io.units import unit_of

every_file = pytest.mark.parametrize("fixture", FIXTURES, ids=lambda one: one.path.name)
TO_MM = {"mm": 1.0, "um": 1e-3, "nm": 1e-6}
TO_N = {"N": 1.0, "mN": 1e-3, "uN": 1e-6, "nN": 1e-9}


def test_each_format_has_two_fixtures_and_a_piece_without_separators_is_no_header():
    for kind in FORMATS:
        assert sum(fixture.format == kind.name for fixture in FIXTURES) >= 2, kind.name
    assert split_header("Force_" + 50 * "of_the_cell_" + "N")[1] == ""
    assert split_header("Force_of_the_cell_N") == ("Force_of_the_cell", "N")


# each damaged file of a binary format is read in a process of its own, which takes a second
APART = [pytest.mark.slow if isinstance(kind, Binary) else () for kind in FORMATS]


@pytest.mark.parametrize(
    "kind",
    [pytest.param(k, marks=apart, id=k.name) for k, apart in zip(FORMATS, APART, strict=True)],
)
def test_each_format_keeps_the_rules(kind, tmp_path):
    own = [fixture for fixture in FIXTURES if fixture.format == kind.name]
    check_format(kind, [fixture.written(tmp_path) for fixture in own])


@every_file
def test_what_was_pressed_comes_back(fixture, in_this_process):
    fixture.content()
    found = convert([fixture.path])
    assert len(found.tests) == fixture.tests
    assert {test.format.name for test in found.tests} == {fixture.format}  # and no other claims it
    # those of an AFM (nm and nN) are as they are
    afm = (found.units.displacement, found.units.force) == ("nm", "nN")
    to_mm, to_n = (1.0, 1.0) if afm else (TO_MM[found.units.displacement], TO_N[found.units.force])
    # two straight lines cannot follow a corner between them: less than a step of 2 mm/s x 5 ms
    corner = 0.01 if fixture.format in ("two-clocks", "ros-table", "rosbag") else 2e-5
    for test in found.tests:
        assert (test.signs.way, test.signs.load) == fixture.signs
        off = test.displacement * to_mm - np.interp(test.time, STORED.time, STORED.way)
        offset = np.median(off)
        # the zero may differ from the truth by what is stated, the shape by the file's digits
        assert abs(offset) < 4.0 * test.contact.sd * to_mm
        assert np.abs(off - offset).max() < corner
        assert np.abs(np.diff(off)).max() < corner
        load = np.interp(test.time, STORED.time, STORED.load)
        assert np.median(np.abs(test.force * to_n - load)) < 2e-5


def test_two_clocks_are_brought_to_one_and_their_lag_is_told():
    (test,) = convert([of_layout("two-clocks-a.csv")]).tests
    assert test.sampling.lag == pytest.approx(LAG, abs=1e-6)
    assert "4.2 ms behind" in " ".join(test.findings)
    ramp = (test.displacement > 0.1) & (test.displacement < 1.0)
    true = np.interp(test.time[ramp], STORED.time, STORED.way)
    # one clock dropped would leave speed x lag = 2 mm/s x 4.2 ms
    assert np.abs(test.displacement[ramp] - true).max() < 0.05 * 2.0 * LAG


BINARY = {kind.name for kind in FORMATS if isinstance(kind, Binary)}
TEXTS = [fixture for fixture in FIXTURES if fixture.format not in BINARY]


@pytest.mark.parametrize("fixture", TEXTS, ids=lambda one: one.path.name)
@pytest.mark.parametrize("cut", [1, 3, 6, 10, 17, 25])
@pytest.mark.few(8)
def test_a_cut_file_gives_a_part_of_the_test_and_no_number_that_is_not_in_it(
    fixture, cut, tmp_path
):
    path = fixture.written(tmp_path)
    kind = recognised(path, FORMATS)
    whole = kind.read(path)[-1]
    path.write_bytes(path.read_bytes()[:-cut])
    part = kind.read(path)[-1]
    lost = len(whole.time.values) - len(part.time.values)
    assert 0 <= lost <= 2
    for channel in ("time", "way", "load"):
        left, all_of_it = getattr(part, channel).values, getattr(whole, channel).values
        np.testing.assert_array_equal(left, all_of_it[: len(left)])


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "cp1252"])
@pytest.mark.parametrize("fixture", TEXTS, ids=lambda one: one.path.name)
@pytest.mark.few(5)
def test_the_letters_code_does_not_matter(fixture, encoding, tmp_path):
    path = fixture.written(tmp_path)
    plain = convert([path])
    data = path.read_bytes().removeprefix(b"\xef\xbb\xbf")
    try:
        text = data.decode("utf-16" if data[:2] == b"\xff\xfe" else "utf-8")
    except UnicodeDecodeError:
        text = data.decode("cp1252")
    path.write_bytes(text.encode(encoding))
    for one, other in zip(plain.tests, convert([path]).tests, strict=True):
        np.testing.assert_array_equal(one.force, other.force)


def test_signs_are_found_and_without_an_approach_or_a_direction_there_is_doubt():
    for way, load in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        found = find_signs(way * STORED.way, load * STORED.load)
        assert (found.way, found.load, found.doubt) == (way, load, "")
    test = pressed(approach=0.0)
    assert find_contact(test.way, test.load) is None
    clock = np.linspace(0.0, 4.0 * np.pi, 400)
    assert "both sides" in find_signs(np.sin(clock), np.sin(clock + 0.1)).doubt


@pytest.mark.parametrize(
    ("text", "quantity", "tidy", "factor"),
    [
        ("(µN)", "force", "uN", 1.0), ("kN", "force", "N", 1e3), ("gf", "force", "N", 9.80665e-3),
        ("N/mm²", "stress", "MPa", 1.0), ("Sec", "time", "s", 1.0), ("%", "strain", "", 0.01),
        ("in", "displacement", "mm", 25.4), ("MPA", "stress", "MPa", 1.0),
        ("mPa", "stress", "Pa", 1e-3), ("MPa", "stress", "MPa", 1.0), ("mN", "force", "mN", 1.0),
        ("MN", "force", "N", 1e6), ("MM", "displacement", "mm", 1.0), ("MS", "time", "ms", 1.0),
        ("mm", "force", None, 0.0), ("Mm", "displacement", None, 0.0), ("Ms", "time", None, 0.0),
        ("mpa", "stress", None, 0.0),
    ],
)  # fmt: skip
def test_units_as_machines_write_them(text, quantity, tidy, factor):
    unit = unit_of(text, quantity)
    assert (unit and unit.tidy) == tidy
    assert unit is None or unit.factor == pytest.approx(factor)


OWN = (CORPUS / "own" / "format.txt").read_text("utf-8")


def test_a_format_of_one_s_own(tmp_path):
    own, data = tmp_path / "own.py", tmp_path / "a.txt"
    own.write_text(OWN)
    np.savetxt(
        data, np.stack([STORED.time, STORED.way, STORED.load], 1), header="BENCH", comments=""
    )
    kinds = (*FORMATS, *own_formats(own))
    assert convert([data], kinds=kinds).tests[0].format.name == "bench"
    with pytest.raises(FormatError, match=r"reading a.txt cut .* ends in ValueError"):
        check_format(kinds[-1], [data, data])
    own.write_text(OWN.replace('"bench"', '"wintest"'))
    with pytest.raises(InputError, match="the format wintest comes with the package"):
        own_formats(own)
    own.write_text(OWN.replace('    reference: ClassVar[str] = "our notebook"\n', ""))
    with pytest.raises(InputError, match="Bench lacks reference"):
        own_formats(own)
    own.write_text("import numpy\n")
    with pytest.raises(InputError, match="defines no format"):
        own_formats(own)


def test_a_format_that_claims_what_is_not_its_own_is_told(tmp_path):
    greedy = replace(BLUEHILL_3, name="greedy", shows={"bytes": ""})
    files = [fixture.written(tmp_path) for fixture in FIXTURES[:2]]
    with pytest.raises(FormatError, match="bluehill-3 claims"):
        check_format(greedy, files)
    with pytest.raises(FormatError, match="lacks read, sniff"):
        check_format(AbstractFormat, files)


MCAP = b"\x89MCAP0\r\n"


def bag(folder, suffix):
    pytest.importorskip("rosbags", reason="rosbags is not installed: no bag is read")
    path = folder / "log.mcap"
    path.write_bytes((CORPUS / "other" / f"joints.{suffix}").read_bytes())
    return path


@pytest.mark.parametrize(
    ("name", "quantity", "unit"),
    [
        ("wrench.force.z", "force", "N"),
        (".pose.position.x", "displacement", "m"),
        ("/tf.transform.translation.y", "displacement", "m"),
        ("/joint_states.position[slide]", "displacement", ""),
        ("/rig/displacement_um.data", "displacement", "um"),
        ("/cell/force.data", "force", ""),
        *((name, None, None) for name in ("wrench.torque.z", "header.stamp.sec", "/t.data",
                                          "pose.orientation.z", "velocity[a]")),
    ],
)  # fmt: skip
def test_a_field_is_told_by_its_path(name, quantity, unit):
    assert (meaning(name) or (None, None))[:2] == (quantity, unit)


def topics(**fields):
    """Topics of one field each: stamps (ns), then the values."""
    stamps = 10_000_000 * np.arange(50)
    for name, values in fields.items():
        topic, _, field = name.partition("__")
        yield [topic, "", "ns"], stamps
        yield [topic, field.replace("_", "."), ""], np.asarray(values, float)


def test_the_axis_that_moves_is_taken_and_a_second_one_as_large_is_refused(tmp_path):
    rise = np.linspace(0.0, 1.0, 50)
    fields = {"a__wrench_force_x": 0.1 * rise, "b__wrench_force_z": rise,
              "c__pose_position_y": 1e-3 * rise, "d__position_1": rise}  # fmt: skip
    (found,) = of_topics(list(topics(**fields)), tmp_path)
    assert (found.load.name, found.way.name) == ("b.wrench.force.z", "c.pose.position.y")
    assert found.way.values[-1] == pytest.approx(1.0)  # mm
    with pytest.raises(InputError, match=r"b.wrench.force.z \(1\)"):
        of_topics(list(topics(**fields, e__wrench_force_y=0.9 * rise)), tmp_path)
    with pytest.raises(InputError, match="no force that changes"):
        of_topics(list(topics(c__pose_position_y=rise)), tmp_path)


@pytest.mark.parametrize(
    ("begins", "name", "words"),
    [(MCAP, "a.mcap", r"pip install 'qlvbayes\[ros\]'"),
     (b"TDSm", "a.tdms", "npTDMS is needed; install it: pip install npTDMS")],
)  # fmt: skip
def test_a_library_that_is_not_there_is_named_with_the_command_that_installs_it(
    tmp_path, monkeypatch, begins, name, words
):
    (tmp_path / name).write_bytes(begins + bytes(100))
    monkeypatch.setattr(binary, "find_spec", lambda module: None)
    with pytest.raises(InputError, match=words):
        convert([tmp_path / name])


@pytest.mark.parametrize("made", ["mcap", "bag"])
@pytest.mark.few(1)
def test_a_bag_that_is_damaged_or_of_a_joint_without_a_unit_is_refused(tmp_path, made):
    path = bag(tmp_path, made)
    path.write_bytes(path.read_bytes()[:20_000])
    with pytest.raises(InputError, match="cut off or damaged"):
        convert([path])
    path = bag(tmp_path, made)
    with pytest.raises(UnsureError, match="unit"):
        convert([path])
    (test,) = convert([path], Answers.from_words(units="s,m,N")).tests
    assert test.units.displacement == "m"
    assert np.ptp(test.displacement) == pytest.approx(1e-3 * np.ptp(STORED.way), rel=0.01)
