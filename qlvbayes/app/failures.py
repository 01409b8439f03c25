"""Describe errors as the page receives them."""

from __future__ import annotations

from typing import Any

from qlvbayes.io.checks import InputError

ErrorContent = dict[str, Any]


class RefusedError(Exception):
    """Exception for a request that is answered with an error: its HTTP status and content."""

    def __init__(self, status: int, content: ErrorContent) -> None:
        super().__init__(content["text"])
        self.status = status
        self.content = content


def error_content(
    message: str, remedy: str | None = None, file: str | None = None, line: int | None = None
) -> ErrorContent:
    """Return the content of an error, with the line that a command would print as ``text``."""
    text = str(InputError(message, file=file, line=line, remedy=remedy))
    return {"message": message, "file": file, "line": line, "remedy": remedy, "text": text}


def content_of(error: Exception) -> ErrorContent:
    """Return the content for an exception: an InputError by its parts, others by kind and text."""
    if isinstance(error, InputError):
        return error_content(error.message, error.remedy, error.file, error.line)
    if isinstance(error, MemoryError):
        return error_content("not enough memory", "open a smaller file")
    text = " ".join(str(error).split())[:300]
    return error_content(f"internal error ({type(error).__name__}: {text})", "report it")


def refused(status: int, message: str, remedy: str | None = None) -> RefusedError:
    """Return a RefusedError, to be raised."""
    return RefusedError(status, error_content(message, remedy))
