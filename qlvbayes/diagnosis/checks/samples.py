"""The samples of all tests, and the errors of predicted forces: of a fit, and of tests left out.

What was left out has no part in the fit, which starts from the mode on all tests, nor in the size
of the discrepancy. Where there is only one test, its phases are left out, one after another.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
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
    """Samples of every test, at most 300 in a phase, and the record that predicts them."""

    experiment: Experiment
    space: Space  # laws and effects, which predict the forces
    rows: tuple[NDArray[np.intp], ...]  # indices of the samples of each test
    # sd of each sample's white noise over the floor's; 1 where the file gives no sd
    weights: tuple[Array, ...]
    record: Record  # of all tests, each sample a block
    contacts: Contacts  # the measured contacts of the tests

    @classmethod
    def from_experiment(
        cls, experiment: Experiment, space: Space, model: Model | None = None
    ) -> Samples:
        """Return the samples of all tests; errors of contacts move the force as that of a model."""
        trials = experiment.trials
        rows = tuple(representative_rows(trial) for trial in trials)
        pairs = list(zip(trials, rows, strict=True))
        weights = tuple(
            np.ones(own.size)
            if trial.test.force_sd is None
            else trial.test.force_sd[own] / experiment.sd_scale
            for trial, own in pairs
        )
        record = batch([experiment.reduced(trial, own) for trial, own in pairs])
        if model is not None:
            record = with_zero_errors(record, trials, model)
        contacts = Contacts.from_trials(trials, trials)
        return cls(experiment, space, rows, weights, record, contacts)

    @property
    def trials(self) -> tuple[Trial, ...]:
        """The tests of the experiment."""
        return self.experiment.trials

    def predict(self, hypothesis: Hypothesis, constants: Array) -> list[Array]:
        """Return the force (K, n) in N at each test's samples for constants (K, P)."""
        return self._of_tests(self.space.forces(hypothesis, constants, self.record))

    def _of_tests(self, values: Array) -> list[Array]:
        """Return values (..., T, B) of blocks as those (..., n) of each test's samples."""
        return [values[..., k, : own.size] for k, own in enumerate(self.rows)]

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
        changes = self.contacts.changes(density.space.record.blocks)
        if not np.any(changes):  # no contact was measured
            return [np.zeros(own.size) for own in self.rows]
        vectors = np.concatenate([residual[None], density.whitener(changes)])
        errors = discrepancy.products(vectors)[:1, 1:]
        return self._of_tests(self.contacts.moved(self.record, errors)[0][0])

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
        return self._of_tests(np.asarray(getattr(self.record.blocks, name)))[k]

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
    if len(samples.trials) > 1:
        return [
            HeldOutPart(density.without(density.whitener.tests == k), k, np.ones(own.size, bool))
            for k, own in enumerate(samples.rows)
        ]
    (trial,), blocks, real = samples.trials, samples.space.record.blocks, samples.space.real
    middle = 0.5 * (np.asarray(blocks.first) + np.asarray(blocks.last))[0, real[0]]
    of_blocks = phase_index(trial.phases, middle)
    of_samples = phase_index(trial.phases, trial.test.time[samples.rows[0]])
    parts = [(of_blocks == k, of_samples == k) for k in range(len(trial.phases))]
    return [
        HeldOutPart(density.without(out), 0, rows)
        for out, rows in parts
        if rows.any() and out.any() and not out.all()
    ]


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
