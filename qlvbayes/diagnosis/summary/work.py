"""The objects that a diagnosis was computed from."""

from __future__ import annotations

from dataclasses import dataclass

from qlvbayes.diagnosis.candidate import Candidate
from qlvbayes.diagnosis.checks.samples import Samples
from qlvbayes.diagnosis.description.describe import NOTHING, Described
from qlvbayes.diagnosis.search import Search
from qlvbayes.io.files import DESCRIBED
from qlvbayes.io.wording import as_typed
from qlvbayes.motion.experiment import Experiment


@dataclass(frozen=True)
class Typed:
    """Paths in commands, as they are typed: the tests, the folder of results, the described law."""

    file: str = "FILE"
    out: str = "OUT"
    law: str = DESCRIBED

    @property
    def design(self) -> str:
        """The command that proposes a test which tells causes apart."""
        return as_typed("qlvbayes", "design", self.out, "--for", "cause")


@dataclass(frozen=True, eq=False)
class DiagnosisWork:
    """Search and samples that a diagnosis was computed from, for figures and predictions."""

    experiment: Experiment
    search: Search
    samples: Samples  # samples of every test, and what predicts them
    # the hypotheses from the baseline to the selected one, each at its highest mode
    path: tuple[Candidate, ...]
    law: Described = NOTHING  # what describes what no listed effect explains
    typed: Typed = Typed()

    @property
    def selected(self) -> Candidate:
        """The hypothesis that stands for the answer."""
        return self.path[-1]
