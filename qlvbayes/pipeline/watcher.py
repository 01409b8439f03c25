"""Define what a study reports while it runs, here or recorded in another process."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any

from qlvbayes.diagnosis.progress import SearchProgress
from qlvbayes.diagnosis.result import DiagnosisResult
from qlvbayes.fitting.ensemble import Progress
from qlvbayes.fitting.residuals import CheckResult
from qlvbayes.fitting.summary import FitSummary
from qlvbayes.report.firstlook import FirstLook


class Watcher:
    """Receiver of a report on each step of a study; this class ignores all of them."""

    def doing(self, label: str) -> AbstractContextManager[Callable[[str], None]]:
        """Begin something that takes a while; yield a function that receives details."""
        return nullcontext(_ignore)

    def sampling(self, label: str) -> AbstractContextManager[Progress]:
        """Begin sampling; yield a function that receives the steps done and the steps to do."""
        return nullcontext(_ignore)

    def notice(self, text: str) -> None:
        """Receive something that the user should know."""

    def looked(self, look: FirstLook, figures: Sequence[Path]) -> None:
        """Receive the first look at the tests, before anything is fitted."""

    def overall(
        self, size: int, *, alone: bool
    ) -> AbstractContextManager[Callable[[int, int], None]]:
        """Begin the work on ``size`` pads; yield a function of the pads done and the pads to do."""
        return nullcontext(_ignore)

    def starting(self, lines: Sequence[str]) -> None:
        """Receive, before a pad is fitted, its tests, the noise floor and the priors in words."""

    def fitted(self, summary: FitSummary) -> None:
        """Receive the summary of a fit."""

    def checked(self, check: CheckResult) -> None:
        """Receive the check of a fit."""

    def searched(self, pad: str, progress: SearchProgress) -> None:
        """Receive the state of the search for the effect that a pad's model lacks."""

    def diagnosed(
        self, result: DiagnosisResult, words: Sequence[str], figures: Sequence[Path]
    ) -> None:
        """Receive the verdict on a pad, its paragraphs in words and its figures."""


def _ignore(*words: Any) -> None:
    """Ignore a report."""


Message = tuple[str, tuple[Any, ...]]
"""Name of a `Watcher`'s method, and its arguments."""


class Recorder(Watcher):
    """Watcher that records a step's reports in a worker, for the user's process to repeat.

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
