"""The second question: whether two pads, or two fluids, differ."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from qlvbayes.comparison.contrast import Comparison, Contrast
from qlvbayes.io.wording import DASH, joined, number, percent_unbroken
from qlvbayes.report.collect import Compared

_FIRST = 2  # paragraphs before the figure
_KINDS = {"greater": "differs", "less": "differs", "equal": "equal"}


@dataclass(frozen=True)
class ContrastRow:
    """A quantity of two pads or fluids: medians, ratio with its interval, and what follows."""

    quantity: str
    unit: str
    first: str
    second: str
    ratio: str
    interval: str
    direction: str
    answer: str
    kind: str
    extrapolated: bool


@dataclass(frozen=True)
class Comparing:
    """The comparison of two pads or fluids, as the page shows it."""

    first: str
    second: str
    what: str
    words: tuple[str, ...]  # the answer, the verdict first
    line: str  # the same in one line
    more: tuple[str, ...]  # what the table has too, quantity by quantity
    groups: tuple[tuple[str, tuple[ContrastRow, ...]], ...]
    region: str
    notices: tuple[str, ...]


def comparing_of(compared: Compared) -> Comparing:
    """Return one comparison as it is shown."""
    comparison = compared.comparison
    first, second = comparison.names
    notices = comparison.notices
    line = _in_a_line(comparison)
    words = comparison.words or compared.words or (line,)
    sentences = [text for text in words if text.rstrip(".").lower() not in map(str.lower, notices)]
    return Comparing(
        first,
        second,
        comparison.between,
        tuple(sentences[:_FIRST]),
        line,
        tuple(sentences[_FIRST:]),
        tuple(_groups(comparison)),
        percent_unbroken(comparison.region),
        notices,
    )


def _in_a_line(comparison: Comparison) -> str:
    """Return whether they differ, and in which constants, or quantities if there are none."""
    pair = " and ".join(comparison.names)
    where = _grouped(comparison, comparison.of_group("constants") or comparison.contrasts)
    if comparison.differ and where.startswith("different "):
        return f"{pair} differ {where.removeprefix('different ')}."
    head = {
        True: f"{pair} differ",
        False: f"No difference between {pair} is shown",
        None: f"These tests cannot tell whether {pair} differ",
    }[comparison.differ]
    return f"{head}: {where}."


def _grouped(comparison: Comparison, contrasts: Sequence[Contrast]) -> str:
    """Return which quantities differ, which are equal, which are open."""
    by_answer: dict[str, list[str]] = {}
    for one in contrasts:
        by_answer.setdefault(_KINDS.get(one.answer, "open"), []).append(one.quantity)
    answers = []
    if "differs" in by_answer:
        answers.append(f"different in {joined(by_answer['differs'])}")
    if "equal" in by_answer:
        answers.append(
            f"equal within {percent_unbroken(comparison.region)} in {joined(by_answer['equal'])}"
        )
    if "open" in by_answer:
        answers.append(f"undecided in {joined(by_answer['open'])}")
    return "; ".join(answers)


def _groups(comparison: Comparison) -> Iterator[tuple[str, tuple[ContrastRow, ...]]]:
    """Yield rows by kind of quantity, in the file's order."""
    for group in dict.fromkeys(one.group for one in comparison.contrasts):
        yield group, tuple(_row(one, *comparison.names) for one in comparison.of_group(group))


def _row(one: Contrast, first: str, second: str) -> ContrastRow:
    ratio = one.ratio
    more = {"greater": f"{first} greater", "less": f"{second} greater"}
    return ContrastRow(
        one.quantity,
        "" if one.unit == "1" else one.unit,
        number(one.first.median),
        number(one.second.median),
        DASH if ratio is None else number(ratio.median),
        "" if ratio is None else f"{number(ratio.low)} to {number(ratio.high)}",
        percent_unbroken(one.direction),
        more.get(one.answer, one.answer),
        _KINDS.get(one.answer, "open"),
        one.extrapolated,
    )
