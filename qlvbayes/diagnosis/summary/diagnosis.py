"""The diagnosis of one pad: the result, what it was computed from, its text and its curves."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtri

from qlvbayes.diagnosis.candidate import Candidate
from qlvbayes.diagnosis.checks.samples import Samples
from qlvbayes.diagnosis.description.describe import NOTHING, Described
from qlvbayes.diagnosis.description.source import ADDED_BY
from qlvbayes.diagnosis.result import DiagnosisResult
from qlvbayes.diagnosis.search import Search
from qlvbayes.diagnosis.summary.grounds import PLACEHOLDERS, Typed, fit_command
from qlvbayes.diagnosis.summary.words import paragraphs
from qlvbayes.inference.errors.features import Features, Locations
from qlvbayes.io.arrays import Array
from qlvbayes.motion.experiment import Experiment, Trial

_BAND = (0.05, 0.95)
_NOISES = ndtri((np.arange(20) + 0.5) / 20.0)  # noise in sds, added to each draw at even quantiles


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


@dataclass(frozen=True, eq=False)
class ForceBand:
    """The force (N) of one model at one test's samples (n,)."""

    mean: np.ndarray  # force at the constants of highest posterior density
    # low, high: 5 % and 95 % quantiles of single readings, from Laplace's approximation of the
    # constants, the discrepancy and the noise floor
    low: np.ndarray
    high: np.ndarray


@dataclass(frozen=True, eq=False)
class Curve:
    """Samples (n,) of one test: the measured force, and that of two models."""

    trial: Trial
    # time, observed: times (s) and measured forces (N)
    time: np.ndarray
    phase: np.ndarray  # kind of phase of each sample
    observed: np.ndarray
    floor: np.ndarray  # sd of the noise (N), measured without a model
    # baseline, final: force of the baseline model and of the selected one; both are the same where
    # nothing was added
    baseline: ForceBand
    final: ForceBand


def curves(diagnosis: Diagnosis, draws: int = 100, seed: int = 0) -> list[Curve]:
    """Return each test's samples with the forces of a diagnosis's baseline and selected models."""
    work = diagnosis.work
    samples = work.samples
    rng = np.random.default_rng(seed)
    baseline = _bands(work, work.path[0], draws, rng)
    final = _bands(work, work.selected, draws, rng) if len(work.path) > 1 else baseline
    return [
        Curve(
            trial,
            trial.test.time[rows],
            samples.phases(k),
            trial.test.force[rows],
            samples.floor(k),
            baseline[k],
            final[k],
        )
        for k, (trial, rows) in enumerate(zip(samples.trials, samples.rows, strict=True))
    ]


def _bands(
    work: DiagnosisWork, candidate: Candidate, draws: int, rng: np.random.Generator
) -> list[ForceBand]:
    """Return the force of one candidate at every test's samples."""
    own, size = candidate.point.own, candidate.mode.size
    thetas = rng.multivariate_normal(
        candidate.point.theta,
        candidate.evidence.covariance,
        draws,
        check_valid="ignore",
        method="eigh",
    )
    thetas = np.concatenate([candidate.point.theta[None], own.within(thetas)])
    forces = work.samples.predict(candidate.hypothesis, own.constants(thetas))
    at_mode = work.samples.forces(work.search.density, candidate.mode)
    bands = []
    for k, force in enumerate(one + (at - one[0]) for one, at in zip(forces, at_mode, strict=True)):
        sd = np.hypot(work.samples.floor(k), size)
        low, high = _quantiles(force[1:], sd)
        bands.append(ForceBand(force[0], low, high))
    return bands


def _quantiles(force: Array, sd: Array) -> tuple[Array, Array]:
    """Return 5 % and 95 % quantiles (n,) of forces (W, n) with normal noise of sd (n,) added."""
    finite = np.isfinite(force).all(axis=1)
    readings = force[finite, None] + sd * _NOISES[:, None]
    low, high = np.quantile(readings.reshape(-1, force.shape[1]), _BAND, axis=0)
    return low, high


@dataclass(frozen=True, eq=False)
class DiscrepancyBand:
    """Mean (N) and sd (N) of the discrepancy at one test's samples (n,)."""

    mean: Array
    sd: Array


def discrepancy(work: DiagnosisWork) -> list[DiscrepancyBand]:
    r"""Return what the selected hypothesis leaves at every test's samples; zero where its size is.

    With the discrepancy's whitened features B (`inference.errors.features`), the variances D of its
    rough part and of noise, and the size s that is likeliest, the coefficients w ~ N(0, s^2) given
    the whitened residual r of the block means are normal,

    .. math:: C = (s^{-2} + B D^{-1} B^T)^{-1}, \quad \hat w = C B D^{-1} r,

    and the discrepancy at any sample is phi^T w. It is an alarm, not an explanation: it says
    nothing about what is missing, and must not be read as a correction of the material's constants.
    """
    samples, selected = work.samples, work.selected
    size, point = selected.mode.size, selected.point
    if size == 0.0:
        return [DiscrepancyBand(np.zeros(own.size), np.zeros(own.size)) for own in samples.rows]
    blocks = samples.space.record.blocks
    prior = work.search.settings.discrepancy
    features = Features.from_locations(
        Locations.from_blocks(work.experiment, samples.trials, blocks, prior)
    )
    # only the smooth functions: the signatures of effects are not defined at single samples
    smooth = len(features.factor)
    mean, root = work.search.density.discrepancy.weights(point.residual, size, smooth)
    forces = samples.predict(selected.hypothesis, point.constants[None])
    bands = []
    for k, (trial, rows) in enumerate(zip(samples.trials, samples.rows, strict=True)):
        locations = Locations.from_trial(
            work.experiment, trial, k, trial.test.time[rows], forces[k][0], prior
        )
        own = features(locations)
        bands.append(DiscrepancyBand(mean @ own, np.sqrt(np.sum((root @ own) ** 2, axis=0))))
    return bands
