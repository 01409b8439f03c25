"""Tests sample by sample: errors in the units of one reading, by test and phase."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from qlvbayes.experiment import Experiment, Trial
from qlvbayes.inference.linearised import force
from qlvbayes.inference.subset import Ensemble, Part
from qlvbayes.kinematics.phases import KINDS
from qlvbayes.noise import Correlated
from qlvbayes.posterior import Posterior
from qlvbayes.predict import thinned_record
from qlvbayes.records.batching import batch
from qlvbayes.records.record import Record


@dataclass(frozen=True, eq=False)
class Samples:
    """Samples of every trial, at most 300 a phase, and the models that predict them.

    rows: which samples of each trial; record: their times, along a leading axis; noise: as measured
    at rest, without a model.
    """

    trials: tuple[Trial, ...]
    rows: tuple[np.ndarray, ...]
    record: Record
    noise: Correlated
    ensemble: Ensemble
    _posteriors: dict[Part, Posterior] = field(default_factory=dict)

    @classmethod
    def of(cls, experiment: Experiment, ensemble: Ensemble) -> Samples:
        """The trials of an experiment, for every subset of an ensemble."""
        rows, records = zip(
            *(thinned_record(experiment, trial) for trial in experiment.trials), strict=True
        )
        return cls(experiment.trials, rows, batch(records), experiment.noise_at_rest, ensemble)

    def predict(self, constants: np.ndarray) -> list[list[np.ndarray]]:
        """Force of constants (W, P) at each trial's samples: [W][T] arrays (n,)."""
        return [self.predict_with(self.ensemble.part(row), row) for row in constants]

    def predict_with(self, part: Part, constants: np.ndarray) -> list[np.ndarray]:
        """Force of constants (P,) at each trial's samples, by a part that holds what is at work."""
        forces = np.asarray(force(self._posterior(part), constants[part.constants]))
        return [forces[k, : rows.size] for k, rows in enumerate(self.rows)]

    def _posterior(self, part: Part) -> Posterior:
        """A part over the samples."""
        if part not in self._posteriors:
            self._posteriors[part] = part.with_record(self.record).posterior
        return self._posteriors[part]

    @property
    def observed(self) -> list[np.ndarray]:
        """Measured force of each trial (n,)."""
        return [t.test.force[rows] for t, rows in zip(self.trials, self.rows, strict=True)]

    def residuals(self, constants: np.ndarray) -> list[np.ndarray]:
        """Measured minus predicted force of each trial (n,), of constants (P,)."""
        predicted = self.predict(constants[None])[0]
        return [one - two for one, two in zip(self.observed, predicted, strict=True)]

    def phases(self, k: int) -> np.ndarray:
        """Kind of phase (n,) of the samples of trial k."""
        return self.trials[k].phase_of(self.trials[k].test.time[self.rows[k]])


@dataclass(frozen=True)
class CellError:
    """Error in one test's samples of one kind of phase: root mean square and mean (N)."""

    test: str
    phase: str
    rate: float
    n: int
    rmse: float
    bias: float


def cell_errors(samples: Samples, residuals: list[np.ndarray]) -> list[CellError]:
    """One entry a test and kind of phase."""
    cells = []
    for k, (trial, residual) in enumerate(zip(samples.trials, residuals, strict=True)):
        phases = samples.phases(k)
        for kind in KINDS:
            here = residual[phases == kind]
            if here.size:
                rmse = float(np.sqrt(np.mean(here**2)))
                cells.append(
                    CellError(
                        trial.name, kind, float(trial.rate), here.size, rmse, float(here.mean())
                    )
                )
    return cells


def rmse(residuals: list[np.ndarray]) -> float:
    """Root mean square over all samples (N)."""
    return float(np.sqrt(np.mean(np.concatenate(residuals) ** 2)))
