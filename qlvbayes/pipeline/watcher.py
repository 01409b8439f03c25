"""Who looks on while a study runs: nobody, unless told otherwise."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any

from qlvbayes.diagnosis.standing import Standing
from qlvbayes.diagnosis.telling.verdict import Diagnosis
from qlvbayes.fitting.checked import CheckedPad
from qlvbayes.fitting.ensemble import Progress
from qlvbayes.fitting.summary import FitSummary
from qlvbayes.model.choices import Choices
from qlvbayes.preprocess.experiment import Experiment
from qlvbayes.preprocess.firstlook import FirstLook


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

    def starting(self, experiment: Experiment, choices: Choices) -> None:
        """A pad is about to be fitted."""

    def fitted(self, summary: FitSummary) -> None:
        """A pad has been fitted."""

    def checked(self, checked: CheckedPad) -> None:
        """A fit has been checked."""

    def searched(self, pad: str, standing: Standing) -> None:
        """A search for what a pad lacks has come so far."""

    def diagnosed(self, found: Diagnosis, figures: Sequence[Path]) -> None:
        """A pad has its verdict."""


def _unheard(*words: Any) -> None:
    """Nobody listens."""
