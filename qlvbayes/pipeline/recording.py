"""What a step reports in another process, recorded there and repeated here."""

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
    """Records what a step reports in a worker, so that it can be repeated where the user sees it.

    Figures are recorded relative to the worker's folder, which may be another one than the user's.
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
    """Report recorded messages to a watcher; folder: where the pad's figures are now."""
    for name, arguments in messages:
        if name == "diagnosed":
            result, words, figures = arguments
            watcher.diagnosed(result, words, [folder / path for path in figures])
        else:
            getattr(watcher, name)(*arguments)
