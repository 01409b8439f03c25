"""Failures of a task, as one line that travels between processes."""

from __future__ import annotations

import errno
import os
import traceback
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from qlvbayes.io.checks import InputError
from qlvbayes.io.wording import listed, visible


@dataclass(frozen=True)
class Fault:
    """A failure: one line with its file, line and remedy."""

    text: str
    # whether the user can mend it (exit status 2), or it is an error of the program (1)
    mendable: bool = True
    of: str = ""  # the pad, or the file, that it happened to

    @property
    def status(self) -> int:
        """Exit status of a command that ends with it."""
        return 2 if self.mendable else 1


def fault_of(error: BaseException) -> Fault:
    """Return the fault of an exception; with ``QLVBAYES_DEBUG`` its traceback is printed too."""
    if os.environ.get("QLVBAYES_DEBUG"):
        traceback.print_exception(error)
    if isinstance(error, InputError):
        return Fault(str(error))
    if isinstance(error, OSError):
        prefix = f"{error.filename}: " if error.filename else ""
        full = error.errno == errno.ENOSPC
        remedy = "free some space" if full else "check the path and its rights"
        return Fault(visible(f"{prefix}{error.strerror or error}; {remedy}"))
    if isinstance(error, MemoryError):
        return Fault("not enough memory; read fewer pads with --pads, or use fewer --jobs")
    text = visible(" ".join(str(error).split())[:300])
    return Fault(
        f"internal error ({type(error).__name__}: {text}); "
        "set QLVBAYES_DEBUG=1 for the traceback and report it",
        mendable=False,
    )


class FailedError(InputError):
    """Exception raised after some of many pads failed; the others were finished.

    faults: why, one each; total: how many pads there were; results: of those that did not fail,
    where they are returned. Several that failed alike are one line.
    """

    def __init__(self, faults: Sequence[Fault], total: int, results: Sequence[Any] = ()) -> None:
        self.faults = tuple(faults)
        self.total = total
        self.results = list(results)
        self.status = min(fault.status for fault in faults)
        super().__init__("; ".join(self.lines))

    @property
    def lines(self) -> list[str]:
        """Return one line for each reason, with the pads that it holds for."""
        reasons: dict[str, list[str]] = {}
        for fault in self.faults:
            reasons.setdefault(fault.text, []).append(fault.of)
        if len(reasons) == 1 and len(self.faults) == self.total:
            return list(reasons)
        lines = [f"{listed(names)}: {text}" for text, names in reasons.items()]
        rest = self.total - len(self.faults)
        return [*lines, f"{len(self.faults)} of {self.total} failed; {rest} are done"]
