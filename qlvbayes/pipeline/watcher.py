"""Who looks on while a study runs: nobody, unless told otherwise."""

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
from qlvbayes.motion.firstlook import FirstLook


class Watcher:
    """Is told of each step of a study; this one says nothing.

    Override what you want to see. Nothing that is returned changes the results.
    """

    def doing(self, label: str) -> AbstractContextManager[Callable[[str], None]]:
        """Something that takes a while; yields a function that tells more of it."""
        return nullcontext(_unheard)

    def sampling(self, label: str) -> AbstractContextManager[Progress]:
        """A chain is about to run; yields a function of the steps done and the steps to do."""
        return nullcontext(_unheard)

    def notice(self, text: str) -> None:
        """Something that the user should know."""

    def looked(self, look: FirstLook, figures: Sequence[Path]) -> None:
        """The tests have been looked at, and nothing is fitted yet."""

    def overall(
        self, size: int, *, alone: bool
    ) -> AbstractContextManager[Callable[[int, int], None]]:
        """So many pads are about to be worked on, one by one or side by side.

        Yields a function of the pads done and the pads to do. Of pads that are worked on by other
        processes each is told as a whole, in order, once it is done.
        """
        return nullcontext(_unheard)

    def starting(self, lines: Sequence[str]) -> None:
        """A pad is about to be fitted: which tests, the noise floor and the priors, in words."""

    def fitted(self, summary: FitSummary) -> None:
        """A pad has been fitted."""

    def checked(self, check: CheckResult) -> None:
        """A fit has been checked."""

    def searched(self, pad: str, standing: SearchProgress) -> None:
        """A search for what a pad lacks has come so far."""

    def diagnosed(
        self, result: DiagnosisResult, words: Sequence[str], figures: Sequence[Path]
    ) -> None:
        """A pad has its verdict, in paragraphs of words too."""


def _unheard(*words: Any) -> None:
    """Nobody listens."""
