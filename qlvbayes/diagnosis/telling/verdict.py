"""A verdict, all that it rests on, and what is said of it."""

from __future__ import annotations

from dataclasses import dataclass

from qlvbayes.diagnosis.result import DiagnosisResult
from qlvbayes.diagnosis.telling.words import paragraphs
from qlvbayes.diagnosis.telling.work import Work


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """What one pad's tests say about the model, and what that was computed from."""

    result: DiagnosisResult
    work: Work

    def paragraphs(self) -> list[str]:
        """What is missing in plain words: a few short paragraphs, the verdict first."""
        return paragraphs(self.result, self.work)

    def text(self) -> str:
        """The paragraphs, an empty line between them: ``diagnosis.txt``."""
        return "\n\n".join(self.paragraphs())
