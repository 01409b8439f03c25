"""Every layout is known by its own format alone, read right, and damaged without a traceback."""

import time
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from support import machine_files
from support.machine_files import FIXTURES, LAG, Pressed, pressed

from qlvbayes.io.checks import InputError
from qlvbayes.io.formats.answers import Answers, UnsureError
from qlvbayes.io.formats.catalogue import FORMATS, own_formats
from qlvbayes.io.formats.columns import split_header
from qlvbayes.io.formats.conformance import FormatError, check_format
from qlvbayes.io.formats.contact import find_contact, find_signs
from qlvbayes.io.formats.conversion import convert
from qlvbayes.io.formats.format import HEAD, AbstractFormat
from qlvbayes.io.formats.layouts import BLUEHILL_3
from qlvbayes.io.formats.machineunits import unit_of
from qlvbayes.io.formats.recognition import matching, recognised

TEST = pressed()
DATA = Path(__file__).parents[2] / "data"
NAMES = [f"{fixture.format}/{fixture.name}" for fixture in FIXTURES]
TO_MM = {"mm": 1.0, "um": 1e-3, "nm": 1e-6}
TO_N = {"N": 1.0, "mN": 1e-3, "uN": 1e-6, "nN": 1e-9}


def written(fixture, folder, test=TEST):
    """The fixture's file in a folder; skips where a package to make or read it is not there."""
    if fixture.needs and find_spec(fixture.needs) is None:
        pytest.skip(f"{fixture.needs} is not installed")
    folder = folder / fixture.format
    folder.mkdir(exist_ok=True)
    path = folder / fixture.name
    path.write_bytes(fixture.make(test))
    return path


@pytest.mark.parametrize("fixture", FIXTURES, ids=NAMES)
def test_each_file_is_claimed_by_its_own_format_and_by_no_other(fixture, tmp_path):
    head = written(fixture, tmp_path).read_bytes()[:HEAD]
    whole, _, _ = matching(head, FORMATS)
    assert [kind.name for kind in whole] == [fixture.format]


def test_each_format_has_two_fixtures_of_its_own():
    for kind in FORMATS:
        assert sum(fixture.format == kind.name for fixture in FIXTURES) >= 2, kind.name


@pytest.mark.parametrize("path", sorted(DATA.glob("*.csv*")), ids=lambda path: path.name)
def test_no_format_claims_a_tidy_file(path):
    head = path.read_bytes()[:HEAD]
    assert not [kind.name for kind in FORMATS if kind.sniff(head).whole]


@pytest.mark.parametrize("kind", FORMATS, ids=lambda kind: kind.name)
def test_each_format_keeps_the_rules(kind, tmp_path):
    own = [fixture for fixture in FIXTURES if fixture.format == kind.name]
    check_format(kind, [written(fixture, tmp_path) for fixture in own])


def scaled(test, units):
    """Displacement and force in mm and N; those of an AFM (nm and nN) as they are."""
    if (units.displacement, units.force) == ("nm", "nN"):
        return test.displacement, test.force
    return test.displacement * TO_MM[units.displacement], test.force * TO_N[units.force]


@pytest.mark.parametrize("fixture", FIXTURES, ids=NAMES)
def test_what_was_pressed_comes_back(fixture, tmp_path):
    found = convert([written(fixture, tmp_path)])
    assert len(found.tests) == fixture.tests
    for test in found.tests:
        assert (test.signs.way, test.signs.load) == fixture.signs
        way, load = scaled(test, found.units)
        known = np.interp(test.time, TEST.time, TEST.way)
        known_load = np.interp(test.time, TEST.time, TEST.load)
        offset = np.median(way - known)
        # the zero may differ from the truth by what is stated, the shape by the file's digits
        assert abs(offset) < 4.0 * test.contact.sd * TO_MM.get(found.units.displacement, 1.0) or (
            found.units.force == "nN" and abs(offset) < 4.0 * test.contact.sd
        )
        # two straight lines cannot follow a corner between them: less than a step of 2 mm/s x 5 ms
        corner = 0.01 if fixture.format in ("two-clocks", "ros-table", "rosbag") else 2e-5
        assert np.abs(way - offset - known).max() < corner
        assert np.median(np.abs(load - known_load)) < 2e-5
        assert np.abs(np.diff(way - known)).max() < corner


def test_two_clocks_are_brought_to_one_and_their_lag_is_told(tmp_path):
    path = tmp_path / "a.csv"
    path.write_bytes(machine_files.two_clocks(TEST))
    (test,) = convert([path]).tests
    assert test.sampling.lag == pytest.approx(LAG, abs=1e-6)
    assert "4.2 ms behind" in " ".join(test.findings)
    ramp = (test.displacement > 0.1) & (test.displacement < 1.0)
    true = np.interp(test.time[ramp], TEST.time, TEST.way)
    # one clock dropped would leave speed x lag = 2 mm/s x 4.2 ms
    assert np.abs(test.displacement[ramp] - true).max() < 0.05 * 2.0 * LAG


TEXTS = [
    f
    for f in FIXTURES
    if f.format not in ("afm", "tdms", "matlab", "hdf5", "testxpert-excel", "rosbag")
]


@pytest.mark.parametrize("fixture", TEXTS, ids=lambda f: f"{f.format}/{f.name}")
@pytest.mark.parametrize("cut", [1, 3, 6, 10, 17, 25])
@pytest.mark.few(38)
def test_a_cut_file_gives_a_part_of_the_test_and_no_number_that_is_not_in_it(
    fixture, cut, tmp_path
):
    path = written(fixture, tmp_path)
    kind = recognised(path, FORMATS)
    whole = kind.read(path)[-1]
    path.write_bytes(path.read_bytes()[:-cut])
    part = kind.read(path)[-1]
    lost = len(whole.time.values) - len(part.time.values)
    assert 0 <= lost <= 2
    for channel in ("time", "way", "load"):
        left, all_of_it = getattr(part, channel).values, getattr(whole, channel).values
        np.testing.assert_array_equal(left, all_of_it[: len(left)])


def test_what_is_lost_is_counted(tmp_path):
    text = machine_files.bluehill_universal(TEST).decode()
    rows = text.split("\n")
    rows[100] = '"pause"'
    rows[101] = rows[101].split(",")[0] + ',"",""'
    rows[102] = rows[103]
    path = tmp_path / "a.csv"
    path.write_text("\n".join(rows)[:-5])
    (test,) = convert([path]).tests
    assert test.dropped == {
        "lines without numbers": 1,
        "rows with an empty cell": 1,
        "rows with the time of the row above": 1,
        "cut last line": 1,
    }


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "cp1252"])
@pytest.mark.parametrize("fixture", TEXTS, ids=lambda f: f"{f.format}/{f.name}")
@pytest.mark.few(20)
def test_the_letters_code_does_not_matter(fixture, encoding, tmp_path):
    path = written(fixture, tmp_path)
    plain = convert([path])
    data = path.read_bytes().removeprefix(b"\xef\xbb\xbf")
    text = data.decode("utf-16") if data[:2] == b"\xff\xfe" else None
    if text is None:
        try:
            text = data.decode()
        except UnicodeDecodeError:
            text = data.decode("cp1252")
    path.write_bytes(text.encode(encoding))
    for one, other in zip(plain.tests, convert([path]).tests, strict=True):
        np.testing.assert_array_equal(one.force, other.force)


def test_gzip_is_undone(tmp_path):
    path = tmp_path / "a.csv.gz"
    path.write_bytes(machine_files.zipped(machine_files.bluehill_3(TEST)))
    assert convert([path]).tests[0].force.max() == pytest.approx(TEST.load.max(), abs=1e-6)
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(InputError, match="gzip data are cut off"):
        convert([path])


@pytest.mark.parametrize(
    ("speed", "rate", "noise"), [(2.0, 200.0, 0.002), (20.0, 1000.0, 0.002), (2.0, 200.0, 0.02)]
)
def test_contact_lies_within_its_interval_as_often_as_it_says(speed, rate, noise):
    """90 % intervals of 60 tests; fewer than 45 hits have a chance of 0.2 % where 54 are meant."""
    rng = np.random.default_rng(7)
    hits = 0
    for seed in range(60):
        test = pressed(rng.uniform(0.2, 0.8), speed=speed, rate=rate, noise=noise, seed=seed)
        found = find_contact(test.way + 3.0, test.load)
        hits += found is not None and abs(found.position - 3.0) < 1.645 * found.sd
    assert hits >= 45


def test_no_contact_is_found_where_there_is_no_approach():
    test = pressed(approach=0.0)
    assert find_contact(test.way, test.load) is None


@pytest.mark.parametrize("way", [1, -1])
@pytest.mark.parametrize("load", [1, -1])
def test_signs_are_found_from_the_data(way, load):
    found = find_signs(way * TEST.way, load * TEST.load)
    assert (found.way, found.load, found.doubt) == (way, load, "")


def test_a_specimen_pushed_and_pulled_is_in_doubt():
    clock = np.linspace(0.0, 4.0 * np.pi, 400)
    assert "both sides" in find_signs(np.sin(clock), np.sin(clock + 0.1)).doubt


def bluehill(test, names="Time,Extension,Load", units="(s),(mm),(N)"):
    rows = "".join(
        f"{t:.5f},{d:.6f},{f:.6f}\n" for t, d, f in zip(test.time, test.way, test.load, strict=True)
    )
    return f"{names}\n{units}\n{rows}"


def refused(tmp_path, text, says, answers=None, error=UnsureError):
    path = tmp_path / "a.csv"
    path.write_text(text)
    with pytest.raises(error, match=says) as caught:
        convert([path], answers or Answers())
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith(str(path))
    return caught.value


def test_what_a_file_leaves_open_is_asked_for(tmp_path):
    preloaded = pressed(approach=-0.3)
    unsure = refused(tmp_path, bluehill(preloaded), "begins in contact")
    assert unsure.option == "contact"
    (test,) = convert([tmp_path / "a.csv"], Answers.from_words(contact="file")).tests
    np.testing.assert_allclose(test.displacement, preloaded.way, atol=1e-6)
    (test,) = convert([tmp_path / "a.csv"], Answers.from_words(contact="0.1")).tests
    np.testing.assert_allclose(test.displacement, preloaded.way - 0.1, atol=1e-6)

    cycles = Pressed(TEST.time, np.sin(9 * TEST.time), np.sin(9 * TEST.time))
    assert refused(tmp_path, bluehill(cycles), "the direction that presses").option == "sign"
    said = Answers.from_words(sign="none", contact="file")
    assert convert([tmp_path / "a.csv"], said).tests[0].signs.way == 1

    strained = bluehill(TEST, "Time,Compressive strain,Load", "(s),(%),(N)")
    assert refused(tmp_path, strained, "strain and force, and no area").option == "area"
    (test,) = convert([tmp_path / "a.csv"], Answers.from_words(area=50.0)).tests
    assert test.units.force == "kPa"
    # 1 N over 50 mm2 is 20 kPa; 1 % is 0.01
    assert test.force.max() == pytest.approx(20.0 * TEST.load.max(), rel=1e-5)
    assert test.displacement.max() == pytest.approx(0.01 * TEST.way.max(), rel=1e-5)


def test_units_that_a_file_does_not_tell_are_asked_for(tmp_path):
    from scipy.io import savemat

    path = tmp_path / "a.mat"
    savemat(path, {"time": TEST.time, "disp": TEST.way, "force": TEST.load})
    with pytest.raises(UnsureError, match=r"'time' .* has no unit"):
        convert([path])
    (test,) = convert([path], Answers.from_words(units="s,um,kN")).tests
    assert test.force.max() == pytest.approx(1e3 * TEST.load.max())
    assert test.units.displacement == "um"
    with pytest.raises(InputError, match="is no unit of force"):
        Answers.from_words(units="s,mm,furlong")
    csv = tmp_path / "b.csv"
    csv.write_text(bluehill(TEST))
    with pytest.raises(InputError, match="is in mm, and --units says um"):
        convert([csv], Answers.from_words(units="s,um,N"))


def test_a_wrong_sign_is_refused(tmp_path):
    says = "with --sign force the specimen is pressed with force negative"
    refused(tmp_path, bluehill(TEST), says, Answers.from_words(sign="force"), InputError)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("a,b\n1,2\n", "no known layout; export CSV"),
        ("Time,Extension,Load\n1,2,3\n", "no test of 10 rows"),
        ("Time,Extension,Load\n", "nearest is bluehill-3, which shows .* but not units in"),
        ("SetName,Cycle,Clock\n", "nearest is cellscale, .* but not a column Time_S"),
        ("\0\0\0", "the file is empty"),
        (bluehill(TEST).replace("(N)", "(N s)"), "the unit 'N s' of Load is unknown"),
        (bluehill(TEST)[:33], "no rows of numbers"),
        (bluehill(Pressed(TEST.time[::-1], TEST.way, TEST.load)), "time falls from"),
        (bluehill(Pressed(TEST.time.round(1), TEST.way, TEST.load)), "the time of the row above"),
        (bluehill(Pressed(TEST.time[:6], TEST.way[:6], TEST.load[:6])), "no test of 10 rows"),
        (bluehill(Pressed(TEST.time, TEST.way, 0 * TEST.load)), "in which displacement and force"),
        ('Time,Disp,Load\n(s),(mm),(N)\n"1,000","2,000","3,000"\n', "may be a decimal comma"),
        ('Time,Disp,Load\n(s),(mm),(N)\n"1,5",2.5,3.5\n', "some numbers have a decimal point"),
    ],
)  # fmt: skip
def test_what_cannot_be_used_is_refused_in_one_line(tmp_path, text, says):
    refused(tmp_path, text, says, error=InputError)


def test_units_as_machines_write_them():
    for text, quantity, tidy, factor in (
        ("(µN)", "force", "uN", 1.0), ("kN", "force", "N", 1e3), ("gf", "force", "N", 9.80665e-3),
        ("MPA", "stress", "MPa", 1.0), ("N/mm²", "stress", "MPa", 1.0), ("Sec", "time", "s", 1.0),
        ("in", "displacement", "mm", 25.4), ("%", "strain", "", 0.01),
    ):  # fmt: skip
        unit = unit_of(text, quantity)
        assert (unit.tidy, unit.factor) == (tidy, pytest.approx(factor))
    assert unit_of("mm", "force") is None


def test_the_prefix_of_a_thousandth_is_never_that_of_a_million():
    for text, quantity, tidy, factor in (
        ("mPa", "stress", "Pa", 1e-3), ("MPa", "stress", "MPa", 1.0), ("mN", "force", "mN", 1.0),
        ("MN", "force", "N", 1e6), ("MM", "displacement", "mm", 1.0), ("MS", "time", "ms", 1.0),
    ):  # fmt: skip
        unit = unit_of(text, quantity)
        assert (unit.tidy, unit.factor) == (tidy, pytest.approx(factor))
    for text, quantity in (("Mm", "displacement"), ("Ms", "time"), ("mpa", "stress")):
        assert unit_of(text, quantity) is None


def test_millipascals_are_not_megapascals(tmp_path):
    path = tmp_path / "a.csv"
    stress = 1e3 * TEST.load
    rows = zip(TEST.time, 10.0 * TEST.way, stress, strict=True)
    body = "".join(f"{t:.3f},{e:.4f},{s:.5f}\n" for t, e, s in rows)
    path.write_text("Time [s],Shear Strain [%],Shear Stress [mPa]\n" + body)
    found = convert([path])
    assert found.units.force == "Pa"
    assert found.tests[0].force.max() == pytest.approx(1e-3 * stress.max(), rel=1e-5)


OWN = """
from typing import ClassVar
import numpy as np
from qlvbayes.io.formats.format import AbstractFormat, Channel, Recording, Sight

class Bench(AbstractFormat):
    name: ClassVar[str] = "bench"
    machine: ClassVar[str] = "our bench"
    marks: ClassVar[str] = "a first line BENCH"
    reads: ClassVar[str] = "three columns"
    reference: ClassVar[str] = "our notebook"

    @staticmethod
    def sniff(head):
        return Sight.from_marks({"a first line BENCH": head.startswith(b"BENCH")})

    @staticmethod
    def read(path):
        t, d, f = np.loadtxt(path, skiprows=1, ndmin=2).T
        return (Recording(Channel("time", t, "s", "t"), Channel("displacement", d, "mm", "d"),
                          Channel("force", f, "N", "f")),)
"""


def test_a_format_of_one_s_own(tmp_path):
    own, data = tmp_path / "own.py", tmp_path / "a.txt"
    own.write_text(OWN)
    np.savetxt(data, np.stack([TEST.time, TEST.way, TEST.load], 1), header="BENCH", comments="")
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
    files = [written(fixture, tmp_path) for fixture in FIXTURES[:2]]
    with pytest.raises(FormatError, match="bluehill-3 claims"):
        check_format(greedy, files)
    with pytest.raises(FormatError, match="lacks read, sniff"):
        check_format(AbstractFormat, files)


def test_a_package_that_is_not_there_is_named_with_the_way_to_get_it(tmp_path, monkeypatch):
    import sys

    path = tmp_path / "a.tdms"
    path.write_bytes(b"TDSm" + bytes(100))
    monkeypatch.setitem(sys.modules, "nptdms", None)
    with pytest.raises(InputError, match="npTDMS is needed; install it: pip install npTDMS"):
        convert([path])


@pytest.mark.slow
def test_a_million_rows_take_less_than_two_seconds(tmp_path):
    path = tmp_path / "a.csv"
    path.write_bytes(machine_files.bluehill_3(pressed(rate=10_000.0, hold=99.2)))
    convert([path])  # imports
    start = time.process_time()
    (test,) = convert([path]).tests
    assert time.process_time() - start < 2.0
    assert len(test.time) > 990_000


def test_a_piece_of_a_file_without_separators_is_no_header():
    assert split_header("Force_" + 50 * "of_the_cell_" + "N")[1] == ""
    assert split_header("Force_of_the_cell_N") == ("Force_of_the_cell", "N")
