"""Text from a file on its way out: one piece for each target, applied where the text is used.

Python takes ``repr``, HTML and XML what jinja2 escapes. The rest is here: what does not print,
command lines, LaTeX, Matplotlib's formulas, cells of a spreadsheet.
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
# What a spreadsheet computes: '=1+1', '@SUM(A1)', '+' or '-' before more than words and numbers.
_FORMULA = re.compile(r"[=@]|[+-](?![\w.,°%/ ]*$)")


def prints(sign: str) -> bool:
    """Whether a character is seen, or is a blank: none that moves a cursor or turns text about."""
    return sign.isprintable() or sign in _JOINERS or unicodedata.category(sign) == "Zs"


def visible(text: str, keep: str = "") -> str:
    r"""The text with what does not print as Python writes it: an escape becomes '\x1b'.

    keep: characters that stay, as the end of a line.
    """
    if text.isprintable():
        return text
    return "".join(c if prints(c) or c in keep else ascii(c)[1:-1] for c in text)


def as_typed(*words: str) -> str:
    """Words as a shell takes them, on one line."""
    return visible(shlex.join(words))


def tex(text: str) -> str:
    """The text as LaTeX sets it."""
    return visible(text).translate(_TEX)


def literal(text: str) -> str:
    r"""The text as Matplotlib writes it: a dollar sign begins no formula."""
    return visible(text).replace("$", r"\$")


def computed(text: str) -> bool:
    """Whether a spreadsheet takes a cell of this text for a formula."""
    return _FORMULA.match(text.lstrip()) is not None


def as_cells(row: Iterable[str]) -> list[str]:
    """Text cells of a table for people; one that would be computed begins with an apostrophe."""
    return [f"'{text}" if computed(text) else text for text in map(visible, row)]
