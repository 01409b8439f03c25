"""Define what a study reports while it runs."""

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
