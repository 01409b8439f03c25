"""Files of a comparison: JSON, CSV, LaTeX and text."""

from __future__ import annotations

import csv
import io
from pathlib import Path

from qlvbayes.comparison.contrast import Comparison, Contrast, Interval, written
from qlvbayes.io.files import results_folder, write_whole
from qlvbayes.io.wording import as_cells, tex, visible

_COLUMNS = ("median", "low90", "high90")


def write_comparison(folder: Path, comparison: Comparison) -> list[Path]:
    """Write compare.json, .csv, .tex and .txt; return their paths."""
    results_folder(folder)
    comparison.write(folder / "compare.json")
    texts = {
        "csv": as_csv(comparison),
        "tex": as_latex(comparison),
        "txt": "\n\n".join(comparison.words) + "\n",
    }
    for suffix, text in texts.items():
        write_whole(folder / f"compare.{suffix}", text.encode())
    return [folder / f"compare.{suffix}" for suffix in ("json", *texts)]


def as_csv(comparison: Comparison) -> str:
    """Return a row for each quantity: medians, central 90 % intervals, probabilities, answer."""
    file = io.StringIO()
    table = csv.writer(file, lineterminator="\n")
    heads = [f"{what}_{c}" for what in ("first", "second", "difference", "ratio") for c in _COLUMNS]
    table.writerow(
        ["quantity", "unit", *heads, "p_first_greater", "p_equivalent", "answer", "extrapolated"]
    )
    for c in comparison.contrasts:
        values = [*_cells(c.first), *_cells(c.second)]
        values += [*_cells(c.difference), *_cells(c.ratio)]
        shares = [f"{c.direction:.6g}", f"{c.equivalence:.6g}"]
        row = [*as_cells([c.quantity, c.unit]), *values, *shares, c.answer]
        row.append("yes" if c.extrapolated else "no")
        table.writerow(row)
    one, other = (visible(" ".join(name.split())) for name in comparison.names)
    return f"# first = {one}, second = {other}; region {comparison.region:g}\n{file.getvalue()}"


def _cells(value: Interval | None) -> list[str]:
    if value is None:
        return ["", "", ""]
    return [f"{x:.6g}" for x in (value.median, value.low, value.high)]


def as_latex(comparison: Comparison) -> str:
    """Return a table for the booktabs package: values, ratio (or difference), answer."""
    one, other = (tex(name) for name in comparison.names)
    lines = [
        "% needs \\usepackage{booktabs}",
        "\\begin{tabular}{llrrrrrl}",
        "\\toprule",
        f"quantity & unit & {one} & {other} & {one}/{other} & $P(>)$ & $P(\\approx)$ & answer \\\\",
        "\\midrule",
        *(_latex_row(c) for c in comparison.contrasts),
        "\\bottomrule",
        "\\end{tabular}",
        f"% median [central 90 \\% interval]; $P(>)$: probability that {one}'s is greater;",
        f"% $P(\\approx)$: that the ratio is within 1/{1 + comparison.region:g} to "
        f"{1 + comparison.region:g}; a ratio that may be 0 or change sign is left out",
    ]
    return "\n".join(lines) + "\n"


def _latex_row(c: Contrast) -> str:
    unit = "" if c.unit == "1" else tex(c.unit)
    ratio = "--" if c.ratio is None else _spread(c.ratio)
    cells = [tex(c.quantity), unit, _spread(c.first), _spread(c.second), ratio]
    return " & ".join([*cells, f"{c.direction:.3f}", f"{c.equivalence:.3f}", c.answer]) + " \\\\"


def _spread(value: Interval) -> str:
    median, low, high = (_number(text) for text in written(value))
    return f"{median} [{low}, {high}]"


def _number(text: str) -> str:
    if "e" not in text:
        return text.replace("-", "$-$")
    mantissa, power = text.split("e")
    return f"${mantissa} \\times 10^{{{int(power)}}}$"
