"""Define the error that a user can correct, and one frequent case of it."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches
from pathlib import Path

from qlvbayes.io.wording import visible

_CLOSE = 0.75  # share of the letters that two names share, in order, of which one is mistyped


class InputError(Exception):
    """Exception for input that cannot be used; its text is one line.

    The line names the file, the line in it and the remedy, as far as they are given.

    >>> str(InputError("force_N is not a number ('abc')", file="pads.csv", line=12,
    ...                remedy="write a number or delete the row"))
    "pads.csv, line 12: force_N is not a number ('abc'); write a number or delete the row"

    message: What is wrong; file: The file that is meant; None where none is; line: The line of that
    file, counted from 1; remedy: What the user can do, as an imperative.
    """

    def __init__(
        self,
        message: str,
        *,
        file: str | Path | None = None,
        line: int | None = None,
        remedy: str | None = None,
    ) -> None:
        self.message = message
        self.file = None if file is None else str(file)
        self.line = line
        self.remedy = remedy
        location = self.file or ""
        if line is not None:
            location += f", line {line}"
        text = f"{location}: {message}" if location else message
        if remedy is not None:
            text += f"; {remedy}"
        super().__init__(visible(" ".join(text.split())))


def meant(name: str, known: Iterable[str]) -> str:
    """Return 'did you mean friction? If not, ' for friktion; empty where no name is close."""
    by_lower = {one.lower(): one for one in known}
    near = get_close_matches(name.lower(), by_lower, n=1, cutoff=_CLOSE)
    return f"did you mean {by_lower[near[0]]}? If not, " if near else ""


def check_known(what: str, name: str, known: Iterable[str]) -> None:
    """Raise InputError where a name is none of the known ones; the error lists them."""
    if name not in (every := tuple(known)):
        remedy = f"{meant(name, every)}use one of {', '.join(every)}"
        raise InputError(f"no {what} {name!r}", remedy=remedy)


class NoFiniteForceError(InputError):
    """Exception for priors of which no draw gives finite forces."""

    def __init__(self) -> None:
        super().__init__(
            "the priors' draws give forces too large for a number", remedy="narrow the priors"
        )
