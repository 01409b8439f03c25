"""The samples of all tests, and the errors of predicted forces: of a fit, and of tests left out.

What was left out has no part in the fit, which starts from the mode on all tests, nor in the size
of the discrepancy. Where there is only one test, its phases are left out, one after another.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from qlvbayes.diagnosis.result import CellError
from qlvbayes.fitting.marginal_likelihood import with_zero_errors
from qlvbayes.fitting.prediction import Contacts, representative_rows
from qlvbayes.inference.density import Density
from qlvbayes.inference.errors.separation import DiscrepancyOfSize
from qlvbayes.inference.forward.hypothesis import Hypothesis
from qlvbayes.inference.forward.space import Space
from qlvbayes.inference.modes import Mode, find_mode
from qlvbayes.io.arrays import Array, Mask
from qlvbayes.model.model import Model
from qlvbayes.motion.experiment import Experiment, Trial
from qlvbayes.motion.phases import KINDS, phase_index
from qlvbayes.motion.record import Record, batch


@dataclass(frozen=True, eq=False)
class Samples:
    """Samples of every test, at most 300 in a phase, and the records that predict them."""

    experiment: Experiment
    space: Space  # laws and effects, whose compiled functions predict the forces
    rows: tuple[NDArray[np.intp], ...]  # indices of the samples of each test
    # sd of each sample's white noise over the floor's; 1 where the file gives no sd
    weights: tuple[Array, ...]
    # records of some samples of every test each. They have the shape of the space's own record, so
    # that nothing has to be compiled anew.
    parts: tuple[Record, ...]
    # for each part, which of the samples of each test it holds
    indices: tuple[tuple[NDArray[np.intp], ...], ...]

    contacts: Contacts  # the measured contacts of the tests

    @classmethod
    def from_experiment(
        cls, experiment: Experiment, space: Space, model: Model | None = None
    ) -> Samples:
        """Return the samples of all tests; errors of contacts move the force as that of a model."""
        contacts = Contacts.from_trials(experiment.trials, experiment.trials)
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
            indices = _split(rows, size)
            parts = tuple(_part(experiment, rows, some, own) for some in indices)
            same = all(p.motion.time.shape == own.motion.time.shape for p in parts)
            if same or size <= own.blocks.force.shape[-1] // 4:
                if model is not None:
                    parts = tuple(with_zero_errors(one, experiment.trials, model) for one in parts)
                return cls(experiment, space, rows, weights, parts, indices, contacts)
            size //= 2

    @property
    def trials(self) -> tuple[Trial, ...]:
        """The tests of the experiment."""
        return self.experiment.trials

    def predict(self, hypothesis: Hypothesis, constants: Array) -> list[Array]:
        """Return the force (K, n) in N at each test's samples for constants (K, P)."""
        predicted = [np.zeros((len(constants), own.size)) for own in self.rows]
        for record, indices in zip(self.parts, self.indices, strict=True):
            forces = self.space.forces(hypothesis, constants, record)
            for k, some in enumerate(indices):
                predicted[k][:, some] = forces[:, k, : some.size]
        return predicted

    def left_out(self) -> Iterator[tuple[Mask, int, Mask]]:
        """Yield the parts that are left out in turn: each test, or each phase of a single test."""
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
        """Measured force (n,) of each test (N)."""
        return [t.test.force[rows] for t, rows in zip(self.trials, self.rows, strict=True)]

    def forces(self, density: Density, mode: Mode) -> list[Array]:
        """Return the force (n,) of each test (N) at a mode, at the contacts that it implies."""
        point = mode.point
        predicted = self.predict(point.own.hypothesis, point.constants[None])
        discrepancy = density.discrepancy.at(mode.size, point.separation)
        moved = self.moved(density, point.residual, discrepancy)
        return [one[0] + more for one, more in zip(predicted, moved, strict=True)]

    def moved(
        self, density: Density, residual: Array, discrepancy: DiscrepancyOfSize
    ) -> list[Array]:
        r"""Return the change (n,) of each test's force (N) by the errors of its contact.

        The errors e, in their sds, change the whitened block means by U (C, n). They are part of
        the covariance of the whitened residual r (n,), which a discrepancy adds to. Their mean is

        .. math:: \hat e = U C^{-1} r.
        """
        moved = [np.zeros(own.size) for own in self.rows]
        changes = self.contacts.changes(density.space.record.blocks)
        if not np.any(changes):  # no contact was measured
            return moved
        vectors = np.concatenate([residual[None], density.whitener(changes)])
        errors = discrepancy.products(vectors)[:1, 1:]
        for record, indices in zip(self.parts, self.indices, strict=True):
            change = self.contacts.moved(record, errors)[0][0]
            for k, some in enumerate(indices):
                moved[k][some] = change[k, : some.size]
        return moved

    def residuals(self, density: Density, mode: Mode) -> list[Array]:
        """Return measured minus predicted force (n,) of each test (N) at a mode."""
        forces = self.forces(density, mode)
        return [one - two for one, two in zip(self.observed, forces, strict=True)]

    def error(self, residuals: Sequence[Array]) -> float:
        """Return the root mean square (N) of residuals of each test, weighted by the stated sds."""
        return rmse(residuals, self.weights)

    def phases(self, k: int) -> NDArray[np.str_]:
        """Return the kind of phase (n,) of the samples of test k."""
        return self.trials[k].phase_of(self.trials[k].test.time[self.rows[k]])

    def of_blocks(self, k: int, name: str) -> Array:
        """Return a quantity (n,) of `Blocks` at the samples of test k, each its own block."""
        values = np.zeros(self.rows[k].size)
        for record, indices in zip(self.parts, self.indices, strict=True):
            values[indices[k]] = np.asarray(getattr(record.blocks, name))[k, : indices[k].size]
        return values

    def floor(self, k: int) -> Array:
        """Return the sd (n,) of the noise at rest of the samples of test k (N)."""
        floor = self.experiment.floor
        return np.hypot(floor.white * self.weights[k], floor.ou)


class HeldOutPart(NamedTuple):
    """Part of the data that is left out of a fit, to be predicted by it."""

    density: Density  # posterior density on everything else
    test: int  # index of the test that the part belongs to
    rows: Mask  # which of the test's samples it holds


class HeldOut(NamedTuple):
    """A part as it is predicted by a fit to everything else."""

    residual: Array  # (n,): measured minus predicted force (N)
    sds: Array  # (n,): stated sds of the samples over the floor's
    constants: Array  # (P,): by the fit


def leave_out(density: Density, samples: Samples) -> list[HeldOutPart]:
    """Return each test as a part to be left out, or each phase where there is only one test."""
    return [HeldOutPart(density.without(out), k, rows) for out, k, rows in samples.left_out()]


def predicted(samples: Samples, parts: Sequence[HeldOutPart], mode: Mode) -> list[HeldOut]:
    """Return what a hypothesis predicts of each part, fitted from its mode on all tests."""
    hypothesis, found = mode.point.own.hypothesis, []
    for density, k, rows in parts:
        own = find_mode(density, hypothesis, mode.point.theta, guess=mode.size) or mode
        own.point.separation.forget()  # of nine long tests, all left out would take a gigabyte
        residual = samples.residuals(density, own)[k][rows]
        found.append(HeldOut(residual, samples.weights[k][rows], own.point.constants))
    return found


def error(parts: Sequence[HeldOut]) -> float:
    """Return the root mean square error (N) over some parts, weighted by the stated sds.

    It is nan of no part, as where there is only one test with one phase.
    """
    if not parts:
        return math.nan
    return rmse([one.residual for one in parts], [one.sds for one in parts])


def _split(rows: Sequence[NDArray[np.intp]], size: int) -> tuple[tuple[NDArray[np.intp], ...], ...]:
    """Return for each part the indices of its samples of every test, ``size`` at most."""
    count = max(-(-own.size // size) for own in rows)
    return tuple(
        tuple(np.arange(own.size)[k * size : (k + 1) * size] for own in rows) for k in range(count)
    )


def _part(
    experiment: Experiment,
    rows: Sequence[NDArray[np.intp]],
    indices: Sequence[NDArray[np.intp]],
    like: Record,
) -> Record:
    """Return the record of one part; a test with no samples in it is filled with its first two."""
    records = [
        experiment.reduced(trial, own[some] if some.size else own[:2])
        for trial, own, some in zip(experiment.trials, rows, indices, strict=True)
    ]
    return batch(records, like)


def cell_errors(samples: Samples, residuals: list[Array]) -> list[CellError]:
    """Return the error of residuals (N) in each test and kind of phase."""
    cells = []
    for k, (trial, residual) in enumerate(zip(samples.trials, residuals, strict=True)):
        phases = samples.phases(k)
        for kind in KINDS:
            here = residual[phases == kind]
            if here.size:
                size, bias = rmse([here]), float(here.mean())
                rate = float(trial.rate) if np.isfinite(trial.rate) else None
                noise = None
                if trial.test.force_sd is not None:
                    noise = rmse([samples.floor(k)[phases == kind]])
                cells.append(CellError(trial.name, kind, rate, here.size, size, bias, noise))
    return cells


def rmse(residuals: Sequence[Array], sds: Sequence[Array] = ()) -> float:
    r"""Return the root mean square of residuals :math:`r` over all samples (N)."""
    weights = np.concatenate(sds) ** -2.0 if sds else None
    return float(np.sqrt(np.average(np.concatenate(residuals) ** 2, weights=weights)))
