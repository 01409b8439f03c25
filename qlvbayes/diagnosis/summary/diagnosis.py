"""The diagnosis of one pad: the result, what it was computed from, and its text."""

from __future__ import annotations

from dataclasses import dataclass, replace

from qlvbayes.diagnosis.candidate import Candidate
from qlvbayes.diagnosis.checks.samples import Samples
from qlvbayes.diagnosis.description.describe import NOTHING, Described
from qlvbayes.diagnosis.description.source import ADDED_BY
from qlvbayes.diagnosis.result import DiagnosisResult
from qlvbayes.diagnosis.search import Search
from qlvbayes.diagnosis.summary.grounds import PLACEHOLDERS, Typed, fit_command
from qlvbayes.diagnosis.summary.words import paragraphs
from qlvbayes.motion.experiment import Experiment


@dataclass(frozen=True, eq=False)
class DiagnosisWork:
    """Search and samples that a diagnosis was computed from, for figures and predictions."""

    experiment: Experiment
    search: Search
    samples: Samples  # samples of every test, and what predicts them
    # the hypotheses from the baseline to the selected one, each at its highest mode
    path: tuple[Candidate, ...]
    law: Described = NOTHING  # what describes what no listed effect explains
    typed: Typed = PLACEHOLDERS

    @property
    def selected(self) -> Candidate:
        """The hypothesis that stands for the answer."""
        return self.path[-1]


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """Diagnosis of one pad: its result, and the search that it was computed from.

    result: What ``diagnosis.json`` holds; work: The search and the samples, for figures and
    predictions.
    """

    result: DiagnosisResult
    work: DiagnosisWork

    def typed(self, file: str, out: str, law: str) -> Diagnosis:
        """Return the diagnosis whose commands name the user's files instead of FILE and OUT."""
        return replace(self, work=replace(self.work, typed=Typed(file, out, law)))

    def paragraphs(self) -> list[str]:
        """Return what is missing in plain words: a few short paragraphs, the verdict first."""
        return paragraphs(self.result, self.work)

    def text(self) -> str:
        """Return the paragraphs with an empty line between them: ``diagnosis.txt``."""
        return "\n\n".join(self.paragraphs())

    @property
    def law_file(self) -> str:
        """Text of the file of the described law, with the command that adds it, or empty."""
        law = self.result.description
        command = fit_command(self.result, self.work, law) if law else ""
        return self.work.law.text.replace(ADDED_BY, command)
