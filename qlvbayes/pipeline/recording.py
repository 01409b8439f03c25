"""Record what a step reports in another process, and repeat it in this one."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from qlvbayes.diagnosis.result import DiagnosisResult
from qlvbayes.fitting.residuals import CheckResult
from qlvbayes.fitting.summary import FitSummary
from qlvbayes.pipeline.watcher import Watcher

Message = tuple[str, tuple[Any, ...]]
"""Name of a `Watcher`'s method, and its arguments."""


class Recorder(Watcher):
    """Record what a step reports in a worker, so that the user's process can repeat it.

    Paths of figures are relative to the worker's folder, which may differ from the user's.
    """

    def __init__(self, folder: Path) -> None:
        self.messages: list[Message] = []
        self._folder = folder

    def notice(self, text: str) -> None:
        """Record a notice."""
        self.messages.append(("notice", (text,)))

    def starting(self, lines: Sequence[str]) -> None:
        """Record that a pad is about to be fitted."""
        self.messages.append(("starting", (lines,)))

    def fitted(self, summary: FitSummary) -> None:
        """Record a fit's summary."""
        self.messages.append(("fitted", (summary,)))

    def checked(self, check: CheckResult) -> None:
        """Record the check of a fit."""
        self.messages.append(("checked", (check,)))

    def diagnosed(
        self, result: DiagnosisResult, words: Sequence[str], figures: Sequence[Path]
    ) -> None:
        """Record a verdict."""
        names = tuple(path.relative_to(self._folder) for path in figures)
        self.messages.append(("diagnosed", (result, tuple(words), names)))


def replay(messages: Sequence[Message], watcher: Watcher, folder: Path) -> None:
    """Report recorded messages to a watcher; folder: the folder that holds the pad's figures."""
    for name, arguments in messages:
        if name == "diagnosed":
            result, words, figures = arguments
            watcher.diagnosed(result, words, [folder / path for path in figures])
        else:
            getattr(watcher, name)(*arguments)
