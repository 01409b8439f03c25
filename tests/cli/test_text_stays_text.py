"""Names from a file are text wherever they go: never code, markup, mathematics, or a formula."""

import csv
import io
import json
import re
import shlex
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from matplotlib import cbook
from matplotlib.figure import Figure
from rich.table import Table
from support.exported_pad import exported

from qlvbayes.app.sessions import BenchPad, HistoryState, Session, commands
from qlvbayes.cli.console import Plain
from qlvbayes.cli.options import among
from qlvbayes.fitting.summary import Entry, as_csv, as_latex
from qlvbayes.io.checks import InputError
from qlvbayes.io.data import read_measurements
from qlvbayes.io.files import folder_fault
from qlvbayes.io.wording import as_typed, computed, prints, visible
from qlvbayes.plots.style import shortened, style, using
from qlvbayes.use.exports.card import card, commented, in_comment
from qlvbayes.use.exports.code import CHeader
from qlvbayes.use.exports.pad import identifier
from qlvbayes.use.exports.target import TARGETS, Geometry

PARTS = [
    '"""; print("x"); """', "'", '"', "\\", "\n", "\r", "\x1b[2J", "\u2028", "\u202e", "[/]",
    "[red]", ":smile:", "$5_{$", "$2 to $3", "\\$", "*/", "/*", "//", "--", "-->", "<!--", "&amp;",
    "</script>", "{{ 7*7 }}", "{% raw %}", "%s", "{0}", "`id`", "$(id)", ";", "|", "=1+1", "-2+3",
    "@SUM(1)", "%{", "#", ",", "_", "^", "~", "é", "油", "a", "B", " ", "7", "\0", "???/", "]]>",
]  # fmt: skip
NASTY = st.lists(st.sampled_from(PARTS), min_size=1, max_size=5).map("".join)
QUICK = settings(
    max_examples=12, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


def session(name):
    model = {"elastic": "exponential", "relaxation": "prony:2", "effects": [], "values": {"m": 1.0}}
    first = HistoryState(0, None, "start", rmse=None, **model)
    added = HistoryState(1, 0, f"add {name}", rmse=None, **(model | {"effects": [name]}))
    pad = BenchPad(history=[first, added], current=1)
    return Session("1", Path(), Path(), name, pads=[name], data=f"/x/{name}", bench={name: pad})


@QUICK
@given(NASTY.filter(lambda name: name.isprintable()))
def test_the_repeated_commands_have_the_name_as_one_word(name):
    lines = commands(session(name), name).splitlines()
    words = shlex.split(lines[0])
    assert words[words.index("--pads") + 1] == name
    assert len(lines) == 4


@QUICK
@given(NASTY)
def test_the_terminal_shows_names_as_they_are_and_nothing_commands_it(name):
    out = io.StringIO()
    console = Plain(file=out, force_terminal=True, width=400)
    console.print(name, soft_wrap=True)
    table = Table(title=name)
    table.add_column(name)
    table.add_row(name)
    console.print(table)
    assert len(as_typed("qlvbayes", name).splitlines()) == 1
    shown = re.sub(r"\x1b\[[\d;]*m", "", out.getvalue())  # the table's own bold and italics
    assert shown.startswith(visible(name, keep="\n") + "\n")
    assert all(prints(sign) or sign == "\n" for sign in shown)


def test_a_message_is_one_line_and_a_style_does_not_hand_names_to_tex():
    assert str(InputError("a\x1b[2J\nb", file="c\x07.csv")) == r"c\x07.csv: a\x1b[2J b"
    with using({"text.usetex": True, "font.size": 9.0}), style():
        figure = Figure()
        assert not figure.text(0.5, 0.5, "50 % \\input{x}").get_usetex()


@pytest.mark.filterwarnings("ignore:Glyph")  # a font that has no letter draws a box
@settings(max_examples=4, deadline=None)
@given(NASTY)
@example("cost $5_{$ a")
@example("_hidden")
def test_figures_write_names_as_they_are(name):
    text = shortened(name, 200)
    assert not cbook.is_math_text(text)
    assert not text.startswith("_")  # or a legend would pass over it
    shown = visible(name)
    assert text.replace(r"\$", "$") == (f" {shown}" if shown.startswith("_") else shown)
    with style():
        figure = Figure(figsize=(2, 2), dpi=40)
        axis = figure.subplots()
        axis.plot([0, 1], [0, 1], label=f"{text} $m_0$")
        axis.set_title(text)
        axis.set_xticks([0.5], [text])
        axis.legend()
        figure.savefig(io.BytesIO(), format="png")


@QUICK
@given(NASTY)
def test_latex_sets_names_as_they_are_and_a_spreadsheet_computes_none(name):
    table = as_latex([Entry(name, "m", "N/mm", 1.0, 0.9, 1.1)])
    head = table.splitlines()[3]
    cell = head.removeprefix("constant & unit & pad ").removesuffix(r" \\")
    sign = r"\\[&%$#_{}]|\\text(?:backslash|asciitilde|asciicircum)\{\}|[^&%$#_{}\\~^\n\r]"
    assert re.fullmatch(f"(?:{sign})*", cell)
    assert len(table.splitlines()) == 8
    row = list(csv.reader(io.StringIO(as_csv([Entry(name, "m", "N/mm", 1.0, 0.9, 1.1)]))))[1]
    assert row[0].removeprefix("'") == visible(name).removeprefix("'")
    assert not computed(row[0])
    assert len(row) == 7


def without_comments(code):
    return re.sub(r"/\*.*?\*/", "", code, flags=re.DOTALL)


def test_every_target_has_the_same_code_whatever_the_name(tmp_path, monkeypatch):
    monkeypatch.setattr("qlvbayes.use.exports.code._binary", lambda sources: None)
    pad = exported(tmp_path)
    hostile = replace(pad, pad="x".join(PARTS), source="a*/ int x; /*".join(PARTS))
    lines = in_comment(card(hostile, CHeader))
    assert not re.search(r"/\*|\*/|--", "\n".join(lines))
    assert len(commented(lines, "%").splitlines()) == len(lines)
    assert commented(lines, "**").isascii()
    for target in TARGETS:
        for name, content in target().files(hostile, Geometry(10.0, 200.0)).items():
            assert re.fullmatch(r"pad_B\w*\.\w+", name)
            if name.endswith((".xml", ".feb", ".sdf")):
                ElementTree.fromstring(content)
            elif name.endswith(".json"):
                assert json.loads(content)["pad"] == hostile.pad
            elif name.endswith((".h", ".c")):
                plain = target().files(pad, Geometry(10.0, 200.0))[name].decode()
                assert without_comments(content.decode()) == without_comments(plain)


def test_identifiers_tell_pads_of_a_folder_apart():
    known = ["A-1", "A 1", "a_1", "油", "水", "B", "x" * 80]
    found = [identifier(name, known) for name in known]
    assert len({name.upper() for name in found}) == len(known)
    assert all(re.fullmatch(r"[A-Za-z]\w{0,62}", name, re.ASCII) for name in found)
    assert identifier("B", known) == "pad_B"
    assert identifier("A-1", ["A-1", "B"]) == "pad_A_1"


def table_of(names):
    out = io.StringIO()
    rows = csv.writer(out, lineterminator="\n")
    rows.writerow(["pad", "test", "time_s", "displacement_mm", "force_N"])
    for pad, test in names:
        rows.writerows([pad, test, k, k / 10, k / 5] for k in range(12))
    return out.getvalue()


@QUICK
@given(pad=NASTY, test=NASTY)
def test_a_file_of_such_names_is_read_or_refused_in_one_line(tmp_path, pad, test):
    file = tmp_path / "data.csv"
    file.write_text(table_of([(pad, test)]), newline="")
    try:
        found, said = read_measurements(file), ""
    except InputError as error:
        said = str(error)
    assert all(map(prints, said))
    if said:
        return
    assert [one.name for one in found.pads] == [pad.strip()]
    assert [one.name for one in found.pads[0].tests] == [test.strip()]
    assert folder_fault(pad.strip()) is None


@pytest.mark.parametrize(
    ("name", "said"),
    [(name, "file of results") for name in (
        "constants.csv", "Report.HTML", "compare", "look_P.png", "measurements.csv", "Study.toml",
    )]
    + [("..", "cannot name a folder"), ("a/b", "cannot name a folder"),
       ("x" * 10_000, "longer than 120 bytes"), ("a\u202eb", "does not print")],
)  # fmt: skip
def test_a_pad_that_cannot_name_its_folder_is_refused_where_it_stands(tmp_path, name, said):
    file = tmp_path / "data.csv"
    file.write_text(table_of([("B", "t"), (name, "t")]))
    with pytest.raises(InputError, match=said) as caught:
        read_measurements(file)
    assert caught.value.line == 14
    assert len(str(caught.value)) < 500


def test_pads_that_differ_in_case_alone_are_refused_and_commas_can_be_chosen(tmp_path):
    file = tmp_path / "data.csv"
    file.write_text(table_of([("Pad b", "t"), ("pad B", "t")]))
    with pytest.raises(InputError, match="differ in upper and lower case only") as caught:
        read_measurements(file)
    assert caught.value.line == 14
    assert among("A, B,C", ["A", "B,C", "B"]) == ["A", "B,C"]
    assert among("a,b, c", ["a", "c"]) == ["a", "b", "c"]
