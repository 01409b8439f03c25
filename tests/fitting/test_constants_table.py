"""Check Table 1 next to what was fitted, as CSV and LaTeX."""

from pathlib import Path

import pandas as pd
import pytest

from qlvbayes.cli.tables import constants_table as constants_table_of
from qlvbayes.cli.tables import pads_table
from qlvbayes.fitting.summary import (
    Constant,
    Entry,
    FitSummary,
    Reference,
    as_csv,
    as_latex,
    constants_table,
    matching_references,
    read_references,
    write_constants,
)
from qlvbayes.io.checks import InputError
from qlvbayes.io.wording import ends, with_ends
from qlvbayes.simulate import TABLE_1

PAPER = Path(__file__).parents[2] / "data" / "paper_table1.csv"


def constant(unit, median, low, high):
    return Constant(unit, median, 0.5 * (high - low), median, (low, high), None, None)


def summary(pad, **parameters):
    return FitSummary(pad=pad, effects=(), sampler="emcee", converged=True, parameters=parameters)


SUMMARY = summary(
    "B_1",
    **{
        "m": constant("N/mm", 0.33617, 0.33036, 0.34208),
        "c[0]": constant("1", 0.29621, 0.2935, 0.299),
        "v[2]": constant("1/s", 0.14, 0.14, 0.14),
        "viscous_drag.eta": constant("N s/mm", -0.00312, -0.0042, -0.002),
        "noise.white": constant("N", 0.006, 0.005, 0.007),
    },
)
KNOWN = {("B_1", "m"): Reference(0.34, "N/mm"), ("other", "m"): Reference(9.0, "N/mm")}


def test_the_paper_s_table_is_what_the_simulator_uses():
    found = read_references(PAPER)
    assert len(found) == 21
    for pad, constants in TABLE_1.items():
        assert found[pad, "m"] == Reference(constants.m, "N/mm")
        assert found[pad, "b"] == Reference(constants.b, "1/mm")
        for k, share in enumerate(constants.c):
            assert found[pad, f"c[{k}]"] == Reference(share, "1")
        for k, rate in enumerate(constants.v, 1):
            assert found[pad, f"v[{k}]"] == Reference(rate, "1/s")


def test_a_constant_of_two_units_has_two_rows():
    """Of pads in mm and in um, or of two laws."""
    pads = [
        summary("P", m=constant("N/mm^n", 1.43, 1.40, 1.46)),
        summary("Q", m=constant("N/um", 0.000798, 0.000794, 0.000801)),
    ]
    rows = as_latex(constants_table(pads)).splitlines()[5:7]
    assert rows[0].split(" & ")[1::2] == ["N/mm\\textasciicircum{}n", "-- \\\\"]
    assert rows[1].split(" & ")[1:3] == ["N/um", "--"]


def test_csv_holds_every_constant_with_interval_and_reference_and_quotes_names(tmp_path):
    entries = constants_table([SUMMARY], KNOWN)
    files = write_constants(tmp_path, entries)
    assert [file.name for file in files] == ["constants.csv", "constants.tex"]
    table = pd.read_csv(files[0], dtype={"pad": str}).set_index("parameter")
    assert list(table.index) == list(SUMMARY.parameters)
    for name, found in SUMMARY.parameters.items():
        row = table.loc[name]
        assert [row["median"], row["low90"], row["high90"]] == [found.median, *found.hdi90]
        assert row["unit"] == found.unit or row["unit"] == 1
    assert table.loc["m", "reference"] == 0.34
    assert table["reference"].isna().sum() == 4
    assert '"B, left"' in as_csv([Entry("B, left", "m", "N/mm", 1.0, 0.9, 1.1)])


def test_latex_gives_two_digits_of_half_the_interval_and_gaps_where_a_pad_has_none():
    lines = as_latex(constants_table([SUMMARY], KNOWN)).splitlines()
    assert "\\begin{tabular}{lllr}" in lines
    assert "constant & unit & pad B\\_1 & reference \\\\" in lines
    assert "$m$ & N/mm & 0.3362 [0.3304, 0.3421] & 0.34 \\\\" in lines
    assert "$c_0$ &  & 0.2962 [0.2935, 0.2990] & -- \\\\" in lines
    assert "$v_2$ & 1/s & 0.14 (fixed) & -- \\\\" in lines
    drag = "viscous\\_drag.eta & N s/mm & $-$0.0031 [$-$0.0042, $-$0.0020] & -- \\\\"
    assert drag in lines
    assert not any("noise" in line for line in lines)
    other = summary("C", m=SUMMARY["m"])
    lines = as_latex(constants_table([SUMMARY, other])).splitlines()
    assert "$c_0$ &  & 0.2962 [0.2935, 0.2990] & -- \\\\" in lines


@pytest.mark.parametrize(
    ("entry", "texts"),
    [
        ((12345.6, 12000.0, 12700.0), ("12350", "12000", "12700")),
        ((1.23e-9, 1.1e-9, 1.4e-9), ("1.23e-09", "1.10e-09", "1.40e-09")),
        ((0.0011003, 0.001095, 0.0011052), ("0.0011003", "0.0010950", "0.0011052")),
        ((-0.3, -1.4, 0.9), ("-0.3", "-1.4", "0.9")),
    ],
)
def test_digits_follow_the_interval(entry, texts):
    assert with_ends(*entry) == texts


@pytest.mark.parametrize("share", [1e-7, 3.1e-4, 0.02, 0.6, 30.0])
@pytest.mark.parametrize("median", [1.1e-9, 1.1003e-3, 0.0997, 2.345, 99961.0])
def test_the_ends_of_an_interval_differ_in_every_table(median, share):
    one = constant("1/um", median, median * (1.0 - share), median * (1.0 + share))
    fit = summary("B", b=one)
    values = one.median, *one.hdi90
    texts = [with_ends(*values), ends(*values), str(fit).strip(" 1/um").split()[1:]]
    told = [*constants_table_of(fit).columns[5].cells, *pads_table([fit]).columns[2].cells]
    texts += [text.replace("(", "").replace(")", "").replace("to ", "").split() for text in told]
    for text in texts:
        *_, low, high = text
        assert low.strip("[,") != high.strip("]")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("pad,parameter,value\n", "line 1: not a table of references"),
        ("# no\n\npad,parameter,value,unit\nA,m,0.5\n", "line 4: 3 columns"),
        ("pad,parameter,value,unit\nA,m,half,N/mm\n", "line 2: value is not a number"),
        ("pad,parameter,value,unit\nA,m,nan,N/mm\n", "line 2: value is not a number"),
        ("pad,parameter,value,unit\nA,m,1,N/mm\nA,m,2,N/mm\n", "line 3: m of pad A again"),
        ("", "not a table of references"),
    ],
)
def test_bad_references_are_refused_with_their_line(tmp_path, text, said):
    file = tmp_path / "known.csv"
    file.write_text(text)
    with pytest.raises(InputError, match=said):
        read_references(file)


def test_references_of_other_units_are_refused_and_of_another_elastic_law_left_out(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        read_references(tmp_path / "none.csv")
    wrong = {("B_1", "m"): Reference(340.0, "N/m")}
    with pytest.raises(InputError, match=r"in N/m; give it in N/mm"):
        constants_table([SUMMARY], wrong)
    # the factor of a power law is no stiffness: its unit tells
    known = {("B_1", "m"): Reference(0.34, "N/mm^n"), ("other", "m"): Reference(9.0, "N/mm")}
    assert list(matching_references(known, [SUMMARY])) == [("other", "m")]
    assert matching_references(KNOWN, [SUMMARY]) == KNOWN
