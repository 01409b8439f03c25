"""Tests sample by sample: errors in the units of one reading, by test and phase."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from qlvbayes.diagnosis.result import CellError
from qlvbayes.fitting.prediction import representative_rows, single_samples
from qlvbayes.inference.forward.hypothesis import Hypothesis
from qlvbayes.inference.forward.space import Space
from qlvbayes.motion.experiment import Experiment, Trial
from qlvbayes.motion.phases import KINDS, phase_index
from qlvbayes.motion.record import Record, batch

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Samples:
    """Samples of every trial, at most 300 a phase, and what predicts them.

    rows: which samples of each trial; weights: of their white noise (1 where no sd was measured);
    parts: records of some samples of every trial each, of the shape of the space's own record, so
    that its compiled functions serve; places: which samples of each trial those are.
    """

    experiment: Experiment
    space: Space
    rows: tuple[NDArray[np.intp], ...]
    weights: tuple[Array, ...]
    parts: tuple[Record, ...]
    places: tuple[tuple[NDArray[np.intp], ...], ...]

    @classmethod
    def of(cls, experiment: Experiment, space: Space) -> Samples:
        """The trials of an experiment."""
        rows = tuple(representative_rows(trial) for trial in experiment.trials)
        weights = tuple(
            np.ones(own.size)
            if trial.test.force_sd is None
            else trial.test.force_sd[own] / experiment.sd_scale
            for trial, own in zip(experiment.trials, rows, strict=True)
        )
        own = space.record
        size = own.blocks.force.shape[-1]
        while True:
            places = _places(rows, size)
            parts = tuple(_part(experiment, rows, some, own) for some in places)
            same = all(p.motion.time.shape == own.motion.time.shape for p in parts)
            if same or size <= own.blocks.force.shape[-1] // 4:
                return cls(experiment, space, rows, weights, parts, places)
            size //= 2

    @property
    def trials(self) -> tuple[Trial, ...]:
        """Those of the experiment."""
        return self.experiment.trials

    def predict(self, hypothesis: Hypothesis, constants: Array) -> list[Array]:
        """Force (K, n) at each trial's samples, of constants (K, P)."""
        found = [np.zeros((len(constants), own.size)) for own in self.rows]
        for record, places in zip(self.parts, self.places, strict=True):
            forces = self.space.forces(hypothesis, constants, record)
            for k, some in enumerate(places):
                found[k][:, some] = forces[:, k, : some.size]
        return found

    def left_out(self) -> Iterator[tuple[Mask, int, Mask]]:
        """What is left out in turn: of the n block means, which test, of its samples.

        Each test, or of one alone each of its phases.
        """
        real = self.space.real
        if len(self.trials) > 1:
            tests = np.broadcast_to(np.arange(len(real))[:, None], real.shape)[real]
            for k, rows in enumerate(self.rows):
                yield tests == k, k, np.ones(rows.size, dtype=bool)
            return
        (trial,) = self.trials
        blocks = self.space.record.blocks
        middle = 0.5 * (np.asarray(blocks.first) + np.asarray(blocks.last))[0, real[0]]
        of_blocks = phase_index(trial.phases, middle)
        of_samples = phase_index(trial.phases, trial.test.time[self.rows[0]])
        for k in range(len(trial.phases)):
            out, rows = of_blocks == k, of_samples == k
            if rows.any() and out.any() and not out.all():
                yield out, 0, rows

    @property
    def observed(self) -> list[Array]:
        """Measured force of each trial (n,)."""
        return [t.test.force[rows] for t, rows in zip(self.trials, self.rows, strict=True)]

    def residuals(self, hypothesis: Hypothesis, constants: Array) -> list[Array]:
        """Measured minus predicted force of each trial (n,), of constants (P,)."""
        predicted = self.predict(hypothesis, constants[None])
        return [one - two[0] for one, two in zip(self.observed, predicted, strict=True)]

    def phases(self, k: int) -> NDArray[np.str_]:
        """Kind of phase (n,) of the samples of trial k."""
        return self.trials[k].phase_of(self.trials[k].test.time[self.rows[k]])

    def floor(self, k: int) -> Array:
        """Sd (n,) of the noise at rest of trial k's samples (N)."""
        floor = self.experiment.floor
        return np.hypot(floor.white * self.weights[k], floor.ou)


def _places(
    rows: Sequence[NDArray[np.intp]], size: int
) -> tuple[tuple[NDArray[np.intp], ...], ...]:
    """At most so many samples of every trial at a time; of one that has none left, the last."""
    count = max(-(-own.size // size) for own in rows)
    return tuple(
        tuple(np.arange(own.size)[k * size : (k + 1) * size] for own in rows) for k in range(count)
    )


def _part(
    experiment: Experiment,
    rows: Sequence[NDArray[np.intp]],
    places: Sequence[NDArray[np.intp]],
    like: Record,
) -> Record:
    """One record of some samples; a trial with none is stood for by its first ones."""
    records = [
        single_samples(experiment, trial, own[some] if some.size else own[:2])
        for trial, own, some in zip(experiment.trials, rows, places, strict=True)
    ]
    return batch(records, like)


def cell_errors(samples: Samples, residuals: list[Array]) -> list[CellError]:
    """One entry a test and kind of phase."""
    cells = []
    for k, (trial, residual) in enumerate(zip(samples.trials, residuals, strict=True)):
        phases = samples.phases(k)
        for kind in KINDS:
            here = residual[phases == kind]
            if here.size:
                size, bias = float(np.sqrt(np.mean(here**2))), float(here.mean())
                rate = float(trial.rate) if np.isfinite(trial.rate) else None
                cells.append(CellError(trial.name, kind, rate, here.size, size, bias))
    return cells


def rmse(residuals: list[Array]) -> float:
    """Root mean square over all samples (N)."""
    return float(np.sqrt(np.mean(np.concatenate(residuals) ** 2)))
