"""What went wrong, as it is told to the page."""

from __future__ import annotations

from typing import Any

from qlvbayes.io.checks import InputError

Told = dict[str, Any]


class RefusedError(Exception):
    """A request that gets an error for an answer: its HTTP status and what is told."""

    def __init__(self, status: int, told: Told) -> None:
        super().__init__(told["text"])
        self.status = status
        self.told = told


def told(
    message: str, remedy: str | None = None, file: str | None = None, line: int | None = None
) -> Told:
    """As in docs/app_api.md."""
    text = str(InputError(message, file=file, line=line, remedy=remedy))
    return {"message": message, "file": file, "line": line, "remedy": remedy, "text": text}


def told_of(error: Exception) -> Told:
    """Of an exception: an InputError by its parts, anything else by its kind and text."""
    if isinstance(error, InputError):
        return told(error.message, error.remedy, error.file, error.line)
    if isinstance(error, MemoryError):
        return told("not enough memory", "open a smaller file")
    text = " ".join(str(error).split())[:300]
    return told(f"internal error ({type(error).__name__}: {text})", "report it")


def refused(status: int, message: str, remedy: str | None = None) -> RefusedError:
    """To be raised."""
    return RefusedError(status, told(message, remedy))
