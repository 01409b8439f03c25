"""The second question: whether two pads, or two fluids, differ."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from qlvbayes.report.collect import Compared
from qlvbayes.report.numbers import DASH, number, percent
from qlvbayes.wording import joined

_FIRST = 2  # paragraphs before the figure
_KINDS = {"greater": "differs", "less": "differs", "equal": "equal"}


@dataclass(frozen=True)
class ContrastRow:
    """One quantity of both: medians, ratio with its interval, and what follows."""

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
    """Two pads or fluids beside each other.

    words: the answer, the verdict first; line: the same in one line; more: what stands in the table
    too, said quantity by quantity.
    """

    first: str
    second: str
    what: str
    words: tuple[str, ...]
    line: str
    more: tuple[str, ...]
    groups: tuple[tuple[str, tuple[ContrastRow, ...]], ...]
    region: str
    notices: tuple[str, ...]


def comparing_of(found: Compared) -> Comparing:
    """One comparison as it is shown."""
    content = found.content
    first, second = content["names"]
    notices = tuple(content.get("notices", ()))
    line = _in_a_line(content)
    words = tuple(content.get("words", ())) or found.words or (line,)
    said = [text for text in words if text.rstrip(".").lower() not in map(str.lower, notices)]
    return Comparing(
        first,
        second,
        "fluids" if content.get("between") == "fluids" else "pads",
        tuple(said[:_FIRST]),
        line,
        tuple(said[_FIRST:]),
        tuple(_groups(content)),
        percent(content.get("region")),
        notices,
    )


def _in_a_line(content: dict) -> str:
    """Whether they differ, and in which constants, or quantities if there are none."""
    pair = " and ".join(content["names"])
    contrasts = [c for c in content["contrasts"] if c.get("group") == "constants"]
    where = _grouped(content, contrasts or content["contrasts"])
    if content.get("differ") and where.startswith("different "):
        return f"{pair} differ {where.removeprefix('different ')}."
    head = {
        True: f"{pair} differ",
        False: f"No difference between {pair} is shown",
        None: f"These tests cannot tell whether {pair} differ",
    }[content.get("differ")]
    return f"{head}: {where}."


def _grouped(content: dict, contrasts: list[dict]) -> str:
    """Which quantities differ, which are equal, which are open."""
    found: dict[str, list[str]] = {}
    for entry in contrasts:
        found.setdefault(_KINDS.get(entry["answer"], "open"), []).append(entry["quantity"])
    said = []
    if "differs" in found:
        said.append(f"different in {joined(found['differs'])}")
    if "equal" in found:
        within = percent(content.get("region"))
        said.append(f"equal within {within} in {joined(found['equal'])}")
    if "open" in found:
        said.append(f"undecided in {joined(found['open'])}")
    return "; ".join(said)


def _groups(content: dict) -> Iterator[tuple[str, tuple[ContrastRow, ...]]]:
    """Rows by kind of quantity, in the file's order."""
    groups = dict.fromkeys(entry.get("group", "") for entry in content["contrasts"])
    for group in groups:
        members = [entry for entry in content["contrasts"] if entry.get("group", "") == group]
        yield group, tuple(_row(entry, *content["names"]) for entry in members)


def _row(entry: dict, first: str, second: str) -> ContrastRow:
    ratio = entry.get("ratio")
    answer = entry["answer"]
    more = {"greater": f"{first} greater", "less": f"{second} greater"}
    unit = entry.get("unit", "")
    return ContrastRow(
        entry["quantity"],
        "" if unit == "1" else unit,
        number(entry["first"]["median"]),
        number(entry["second"]["median"]),
        DASH if ratio is None else number(ratio["median"]),
        "" if ratio is None else f"{number(ratio['low'])} to {number(ratio['high'])}",
        percent(entry.get("direction")),
        more.get(answer, answer),
        _KINDS.get(answer, "open"),
        bool(entry.get("extrapolated")),
    )
