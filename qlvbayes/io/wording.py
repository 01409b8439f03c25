"""Numbers and lists of words as text, and text of a file escaped for each output.

Numbers are in ASCII for messages and tables, and typeset for the page. Python text uses ``repr``;
HTML and XML use what jinja2 escapes. This module does the rest: characters that do not print,
command lines, LaTeX, Matplotlib's formulas, cells of a spreadsheet.
"""

from __future__ import annotations

import re
import shlex
import unicodedata
from collections.abc import Collection, Iterable
from math import floor, inf, isfinite, log10

DASH = "–"  # for what is not known
UNNAMED = "pad"  # name of the only pad of a file that has no names
NBSP = "\u00a0"  # between a number and its unit, where no line may break
_JOINERS = "\u200c\u200d"  # shape letters of several scripts; they move nothing
_TEX = str.maketrans(
    {
        **{sign: f"\\{sign}" for sign in "&%$#_{}"},
        "\\": r"\textbackslash{}",
        "~": r"\textasciitilde{}",
        "^": r"\textasciicircum{}",
    }
)
# A spreadsheet computes '=1+1', '@SUM(A1)', and '+' or '-' before more than words and numbers.
_FORMULA = re.compile(r"[=@]|[+-](?![\w.,°%/ ]*$)")
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def plain(value: float, digits: int = 3) -> str:
    """Return significant digits, without a power of ten from 0.0001 to 10 million."""
    text = f"{value:.{digits}g}"
    if "e" not in text or not 1.0 <= abs(value) < 1e7:
        return text
    return f"{round(value, digits - 1 - floor(log10(abs(value)))):.0f}"


def rated(rate: float, unit: str) -> str:
    """Return three digits of a speed or a loading rate with its unit: '29.3 mm/s', '0.226/s'."""
    return f"{plain(rate)} {unit}".replace(" 1/", "/")


def to_noise(value: float, noise: float, sign: str = "") -> str:
    """Return a number to a hundredth of the noise's first digit."""
    decimals = max(0, 2 - floor(log10(noise))) if noise > 0.0 else 4
    text = f"{value:{sign}.{decimals}f}" if decimals <= 6 else f"{value:{sign}.2g}"
    return text.replace("-", sign, 1) if float(text) == 0.0 else text


def percent(share: float) -> str:
    """Return a probability in two digits, or three near 1; it is never written as certain."""
    if share > 0.999:
        return "> 99.9 %"
    return "< 0.1 %" if share < 0.001 else f"{100.0 * share:.{3 if share > 0.98 else 2}g} %"


def joined(words: list[str], last: str = "and") -> str:
    """Return words as 'a, b and c'."""
    return f"{', '.join(words[:-1])} {last} {words[-1]}" if len(words) > 1 else "".join(words)


def listed(words: Collection[str], most: int = 20) -> str:
    """Return words as 'a, b, c', of very many the first ones and how many more there are."""
    more = f" and {len(words) - most} more" if len(words) > most else ""
    return ", ".join(list(words)[:most]) + more


def of_lines(count: int, what: str) -> str:
    """Return '1 row with a gap' or '3 rows with a gap' of 'rows with a gap'."""
    first, _, rest = what.partition(" ")
    return f"{count} {first.removesuffix('s') if count == 1 else first} {rest}"


def capitalized(text: str) -> str:
    """Return the text with its first letter in upper case, the others as they are."""
    return f"{text[:1].upper()}{text[1:]}"


def significant(value: float, sd: float, largest: float = 0.0) -> str:
    """Return a number with two digits of its sd (four significant ones where it has none).

    Beyond six decimals it may have a power of ten; ``largest`` is the largest number beside it.
    """
    if not 0.0 < sd < inf:
        return f"{value:.4g}"
    decimals = 1 - floor(log10(sd))
    if decimals > 6:
        return f"{value:#.{decimals + 1 + floor(log10(max(abs(value), largest, sd)))}g}"
    return f"{round(value, decimals):z.{max(decimals, 0)}f}"


def with_ends(median: float, low: float, high: float) -> tuple[str, str, str]:
    """Return a median and the ends of its interval, to two digits of half the interval's width.

    So the ends differ, in every table and on every page.
    """
    half, largest = 0.5 * (high - low), max(abs(low), abs(high))
    middle, begin, end = (significant(x, half, largest) for x in (median, low, high))
    return middle, begin, end


def number(value: float | None, digits: int = 3, *, zeros: bool = False) -> str:
    """Return significant digits, typeset; '1.2 × 10⁻⁷' for the very small and large."""
    if value is None or not isfinite(value):
        return DASH
    text = (f"{value:#.{digits}g}" if zeros else f"{value:.{digits}g}").removesuffix(".")
    power = int(text.partition("e")[2] or -1)
    return typeset(f"{round(value, digits - 1 - power):.0f}" if 0 <= power < 7 else text)


def typeset(text: str) -> str:
    """Return a number's text with a minus, and a power of ten as '1.2 × 10⁻⁷'."""
    base, _, power = text.replace("-", "−").partition("e")
    raised = str(int(power.replace("−", "-") or 0)).translate(_SUPERSCRIPT)
    return f"{base} × 10{raised}" if power else base


def ends(median: float, low: float, high: float) -> list[str]:
    """Return a median and the ends of its interval as `with_ends` does, typeset."""
    return [typeset(text) for text in with_ends(median, low, high)]


def to_sd(value: float | None, sd: float | None) -> str:
    """Return a number as `significant` does, typeset; a dash where it is not known."""
    if value is None or not sd or not isfinite(sd):
        return number(value, 4)
    return typeset(significant(value, sd))


def percent_unbroken(share: float | None) -> str:
    """Return a probability as `percent` does, without a place where a line could break."""
    if share is None or not isfinite(share):
        return DASH
    return percent(share).replace(" ", NBSP)


def with_unit(text: str, unit: str) -> str:
    """Return a number and its unit, '0.34 N/mm'; the number alone where the unit is 1."""
    return text if unit in ("", "1") else f"{text}{NBSP}{unit}"


def pad_title(name: str) -> str:
    """Return 'pad B', or 'the pad' where the file does not name it."""
    return "the pad" if name == UNNAMED else f"pad {name}"


def prints(sign: str) -> bool:
    """Return whether a character is visible or a blank: none that moves a cursor or turns text."""
    return sign.isprintable() or sign in _JOINERS or unicodedata.category(sign) == "Zs"


def visible(text: str, keep: str = "") -> str:
    r"""Return the text with characters that do not print written as Python does: '\x1b'."""
    if text.isprintable():
        return text
    return "".join(c if prints(c) or c in keep else ascii(c)[1:-1] for c in text)


def as_typed(*words: str) -> str:
    """Return words as a shell command on one line."""
    return visible(shlex.join(words))


def tex(text: str) -> str:
    """Return the text escaped for LaTeX."""
    return visible(text).translate(_TEX)


def literal(text: str) -> str:
    """Return the text escaped for Matplotlib: a dollar sign begins no formula."""
    return visible(text).replace("$", r"\$")


def computed(text: str) -> bool:
    """Return whether a spreadsheet takes a cell with this text for a formula."""
    return _FORMULA.match(text.lstrip()) is not None


def as_cells(row: Iterable[str]) -> list[str]:
    """Return text cells for a spreadsheet; an apostrophe precedes any that would be computed."""
    return [f"'{text}" if computed(text) else text for text in map(visible, row)]
