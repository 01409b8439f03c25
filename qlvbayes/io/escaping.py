"""Escape text from a file for each output, where the text is used.

Python text uses ``repr``; HTML and XML use what jinja2 escapes. This module does the rest:
characters that do not print, command lines, LaTeX, Matplotlib's formulas, cells of a spreadsheet.
"""

from __future__ import annotations

import re
import shlex
import unicodedata
from collections.abc import Iterable

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
