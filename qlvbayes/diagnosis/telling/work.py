"""What a verdict rests on."""

from __future__ import annotations

from dataclasses import dataclass

from qlvbayes.diagnosis.checks.adequacy import Adequacy
from qlvbayes.diagnosis.checks.samples import Samples
from qlvbayes.diagnosis.search import Search
from qlvbayes.diagnosis.weighed import Weighed
from qlvbayes.motion.experiment import Experiment


@dataclass(frozen=True, eq=False)
class Work:
    """What a diagnosis was computed from, for figures and for what follows.

    path: the hypotheses of the stages, each at its likeliest mode.
    """

    experiment: Experiment
    search: Search
    samples: Samples
    path: tuple[Weighed, ...]
    adequacies: tuple[Adequacy, ...]

    @property
    def told(self) -> Weighed:
        """The hypothesis that stands for the answer."""
        return self.path[-1]
