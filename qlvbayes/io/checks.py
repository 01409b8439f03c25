"""The one error a user can mend, and the small checks that raise it."""

from __future__ import annotations

from pathlib import Path

from qlvbayes.io.escaping import visible


class InputError(Exception):
    """Something the user gave cannot be used; the text is one line with place and remedy.

    >>> str(InputError("force_N is not a number ('abc')", file="pads.csv", line=12,
    ...                remedy="write a number or delete the row"))
    "pads.csv, line 12: force_N is not a number ('abc'); write a number or delete the row"

    message, file, line, remedy: its parts, None where they were not given.
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
        place = self.file or ""
        if line is not None:
            place += f", line {line}"
        text = f"{place}: {message}" if place else message
        if remedy is not None:
            text += f"; {remedy}"
        super().__init__(visible(" ".join(text.split())))


class NoFiniteForceError(InputError):
    """No draw of the priors gives forces that a number can hold."""

    def __init__(self) -> None:
        super().__init__(
            "the priors' draws give forces too large for a number", remedy="narrow the priors"
        )
