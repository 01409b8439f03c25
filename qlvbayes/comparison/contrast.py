"""Results of a comparison: each quantity of both, difference, ratio and answer; their files."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path

from qlvbayes.io.files import Part, Result, results_folder, write_whole
from qlvbayes.io.units import PAD, UnitSystem
from qlvbayes.io.wording import as_cells, tex, visible, with_ends

SHARE = 0.90  # of the draws, that an interval holds
DECIDED = 0.975  # probability of direction at which one is called greater
EQUAL = 0.95  # probability of equivalence at which two are called equal
BY_CHANCE = 2.0 * (1.0 - DECIDED)  # of equal quantities that are called different


class Interval(Part, frozen=True):
    """Median and ends of the central 90 % interval."""

    median: float
    low: float
    high: float


class Contrast(Part, frozen=True):
    """A quantity of two pads or two fluids, with its difference, its ratio and an answer."""

    quantity: str
    first: Interval
    second: Interval
    unit: str
    difference: Interval  # first minus second
    # first over second, None where one of them may be zero or change its sign
    ratio: Interval | None
    direction: float  # probability that the first is greater
    equivalence: float  # probability that the ratio lies within 1/(1 + region) .. 1 + region
    # ``equal`` (equivalence at least 95 %), else ``greater`` or ``less`` (direction at least 97.5 %
    # or at most 2.5 %), else ``cannot tell``
    answer: str
    group: str = "constants"  # kind of quantity
    extrapolated: bool = False  # whether the tests of one of them do not reach so far
    # ends of the central 95 % interval of the ratio: it is clear of 1 where one is called greater
    ratio95: tuple[float, float] | None = None


class Omnibus(Part, frozen=True):
    """The joint test of all shared constants."""

    # statistic, freedom: chi-square and its degrees of freedom (None between fluids, where the
    # smallest probability of a wrong direction is corrected for the number of constants)
    statistic: float | None
    freedom: int
    p_value: float  # probability of so large a difference between equals
    # the level at which they are called different, which is the share of equal pairs so called
    false_alarms: float
    # ``constants``, or ``shown`` where the tests do not hold each other's relaxation times, and
    # what all of them show is tested instead
    over: str = "constants"


class ReadAt(Part, frozen=True, rename={"frequencies": "frequencies_Hz", "hold": "hold_s"}):
    """The depth (mm), rates (mm/s), frequencies (Hz) and hold (s) at which quantities are read."""

    depth: float
    rates: tuple[float, ...]
    frequencies: tuple[float, ...]
    hold: float


class Comparison(Result, frozen=True, kw_only=True):
    """Comparison of two pads or two fluids, quantity by quantity: ``compare.json``.

    names: Names of the first and of the second; between: ``pads``, or ``fluids`` where both have
    two specimens or more; units: Units of displacement and force, those of the first pad;
    specimens: Numbers of specimens of the first and of the second; region: Region of practical
    equivalence: ratios within 1/(1 + region) .. 1 + region count as equal; differ: True where the
    joint test calls the two different; False where it does not and each tested quantity is equal
    within the region; None where the data cannot tell; omnibus: The joint test of the shared
    constants, or of the quantities that all tests show; None where there was nothing to test;
    by_chance: Expected number of quantities that would be called different one by one if all were
    equal; settings: Depth, rates, frequencies and hold at which quantities are read; None where
    none are stated; contrasts: One entry for each quantity, the shared constants first; notices:
    One sentence on each limit of the comparison; words: The answer in sentences.
    """

    names: tuple[str, str]
    between: str
    units: UnitSystem = PAD
    specimens: tuple[int, int] = (1, 1)
    region: float
    differ: bool | None
    omnibus: Omnibus | None = None
    by_chance: float = 0.0
    settings: ReadAt | None = None
    contrasts: tuple[Contrast, ...]
    notices: tuple[str, ...] = ()
    words: tuple[str, ...] = ()

    def __getitem__(self, quantity: str) -> Contrast:
        """Return the contrast of that quantity; KeyError lists the others."""
        for contrast in self.contrasts:
            if contrast.quantity == quantity:
                return contrast
        raise KeyError(f"{quantity} is none of {', '.join(c.quantity for c in self.contrasts)}")

    def of_group(self, group: str) -> Sequence[Contrast]:
        """Return the contrasts of one kind."""
        return [contrast for contrast in self.contrasts if contrast.group == group]


def written(value: Interval) -> tuple[str, str, str]:
    """Format median, low and high as every table does."""
    return with_ends(value.median, value.low, value.high)


def with_interval(value: Interval) -> str:
    """Format as ``1.07 [1.04, 1.10]``."""
    median, low, high = written(value)
    return f"{median} [{low}, {high}]"


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
