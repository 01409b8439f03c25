"""Offer a study for interactive work: pads by name, each to look at, fit and diagnose."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from operator import methodcaller
from pathlib import Path
from typing import Any, TypeVar

from qlvbayes.diagnosis.diagnose import SearchProgress, diagnose
from qlvbayes.diagnosis.result import DiagnosisResult
from qlvbayes.diagnosis.search import Report
from qlvbayes.diagnosis.settings import DiagnosisSettings
from qlvbayes.diagnosis.summary.diagnosis import Diagnosis
from qlvbayes.effects.effect import AbstractEffect
from qlvbayes.fitting.ensemble import Progress, Settings
from qlvbayes.fitting.fit import Fit, fit_pad
from qlvbayes.io.checks import InputError
from qlvbayes.io.data import Measurements, Pad, read_measurements
from qlvbayes.model.choices import Choices
from qlvbayes.motion.experiment import Experiment, prepare
from qlvbayes.parallel.engines import engine_of
from qlvbayes.parallel.running import FailedError, run_all
from qlvbayes.pipeline.source import Source
from qlvbayes.report.firstlook import PadSeen, look_at

Answer = TypeVar("Answer")


@dataclass(frozen=True, eq=False)
class Specimen:
    """A pad with its tests, ready to be fitted and diagnosed.

    Where no `Choices` are given they are the defaults, bonded where the tests hold strain and
    stress.

    pad: The pad: its name, its tests, their units and, where it is known, its fluid.
    """

    pad: Pad

    def __repr__(self) -> str:
        """Return ``<pad B, 6 tests>``."""
        count = len(self.pad.tests)
        return f"<pad {self.pad.name}, {count} test{'' if count == 1 else 's'}>"

    @cached_property
    def experiment(self) -> Experiment:
        """Prepared tests: motion, phases, rates, roles and the noise floor.

        Bad readings are left out; a fit whose choices keep them prepares the tests again.
        """
        return prepare(self.pad)

    def look(self, *, bonded: bool | None = None) -> PadSeen:
        """Return what is in the tests and what of the model they can show; nothing is fitted.

        ``plots.plot_look`` draws ``experiment``. An InputError where a test cannot be used.

        Parameters
        ----------
        bonded
            Whether the specimen is fixed to the platen, by default where it is strain and stress.
        """
        fixed = self.pad.units.bonded_default if bonded is None else bonded
        return look_at(self.experiment, bonded=fixed)

    def fit(
        self,
        choices: Choices | None = None,
        *,
        method: str = "emcee",
        all_tests: bool = False,
        settings: Settings | None = None,
        folder: str | Path | None = None,
        progress: Progress | None = None,
    ) -> Fit:
        """Draw the model's constants from their posterior.

        Parameters
        ----------
        choices
            The model: laws, effects, noise, priors.
        method
            ``emcee`` samples; ``least-squares`` and ``two-step`` are the paper's routes, whose
            draws come from the normal approximation at the optimum.
        all_tests
            Whether tests that would validate are fitted too.
        settings
            Settings of the sampler: walkers, steps and seed.
        folder
            Folder that keeps the growing chain, so that a killed run continues where it stopped.
        progress
            Function that receives the steps done and the steps to do.

        Raises
        ------
        InputError
            A choice cannot be used with these tests.
        """
        choices = choices or Choices(bonded=self.pad.units.bonded_default)
        return fit_pad(
            self._ready(choices, all_tests=all_tests), choices, method=method, settings=settings,
            folder=None if folder is None else Path(folder), progress=progress,
        )  # fmt: skip

    def diagnose(
        self,
        choices: Choices | None = None,
        *,
        kinds: Sequence[type[AbstractEffect]] | None = None,
        thresholds: DiagnosisSettings | None = None,
        seed: int = 0,
        report: Report = lambda text: None,
        watch: Callable[[SearchProgress], None] = lambda progress: None,
    ) -> Diagnosis:
        """Say what the model lacks, a law or effects, from all tests.

        Parameters
        ----------
        choices
            The model to start from.
        kinds
            Effects that are looked for: by default the list, and those of the choices' own file.
        thresholds
            Prior probabilities, and the probability that a verdict needs.
        seed
            Seed of the draws of priors from which hypotheses are optimised.
        report
            Function that receives a line on each step of the search.
        watch
            Function that receives the state of the search at each step; it may raise `StopSearch`
            to end the search.

        Raises
        ------
        InputError
            The noise model is not Gaussian, or a choice cannot be used with these tests.
        """
        choices = choices or Choices(bonded=self.pad.units.bonded_default)
        return diagnose(
            self._ready(choices), choices, settings=thresholds, seed=seed, report=report,
            kinds=choices.candidates if kinds is None else kinds, watch=watch,
        )  # fmt: skip

    def _ready(self, choices: Choices, *, all_tests: bool = False) -> Experiment:
        if not (all_tests or choices.keep_all_readings or choices.use or choices.leave_out):
            return self.experiment
        return choices.prepare(self.pad, all_tests=all_tests)


@dataclass(frozen=True, eq=False, repr=False)
class Study(Measurements):
    """All pads of one file by name: ``study["B"]`` is a `Specimen`.

    Iteration yields the names of the pads in the file's order, and ``len(study)`` is their number.

    pads: The pads, in the file's order; units: Units of displacement and force of all pads; source:
    Path of the file; sha256: SHA-256 digest of the file, in hexadecimal digits; notices: Sentences
    on how the file was read.
    """

    def __getitem__(self, name: str) -> Specimen:
        """Return the pad of that name; InputError lists the known names otherwise."""
        return self._specimens[self.pad(name).name]

    def __iter__(self) -> Iterator[str]:
        """Yield the pads' names, in the file's order."""
        return iter(self._specimens)

    def __len__(self) -> int:
        """Return how many pads there are."""
        return len(self.pads)

    def __repr__(self) -> str:
        """Return ``<study pads.csv: A, B, C>``."""
        return f"<study {Path(self.source).name}: {', '.join(self)}>"

    def fit(
        self, choices: Choices | None = None, *, client: Any = None, **options: Any
    ) -> dict[str, Fit]:
        """Draw the constants of every pad from their posterior; return the fits by pad.

        ``choices`` and the other options are those of `Specimen.fit`. ``client`` is a
        ``distributed.Client``, or an executor with ``submit`` such as a ``ProcessPoolExecutor``
        that spawns, that does the work; by default this process does, one pad after the other. An
        InputError where it takes no work or is lost; a FailedError, whose ``results`` are the
        others, where pads failed.
        """
        return self._each(methodcaller("fit", choices, **options), client)

    def diagnose(
        self, choices: Choices | None = None, *, client: Any = None, **options: Any
    ) -> dict[str, DiagnosisResult]:
        """Say of every pad what the model lacks; return the results by pad.

        ``choices`` and the other options are those of `Specimen.diagnose`, ``client`` and the
        errors those of `fit`.
        """
        return self._each(partial(_result_of, methodcaller("diagnose", choices, **options)), client)

    def _each(self, task: Callable[[Specimen], Answer], client: Any) -> dict[str, Answer]:
        outcomes = list(run_all(task, map(Specimen, self.pads), engine_of(client)))
        named = [(one.item.pad.name, one) for one in outcomes]
        results: dict[str, Answer] = {k: one.answer for k, one in named if one.fault is None}
        faults = [replace(one.fault, of=f"pad {k}") for k, one in named if one.fault is not None]
        if faults:
            raise FailedError(faults, len(self), list(results.values()))
        return results

    @cached_property
    def _specimens(self) -> dict[str, Specimen]:
        # each is made once, so that its tests are prepared once
        return {pad.name: Specimen(pad) for pad in self.pads}


def _result_of(diagnosed: Callable[[Specimen], Diagnosis], specimen: Specimen) -> DiagnosisResult:
    return diagnosed(specimen).result


def read_study(path: str | Path | Sequence[str | Path]) -> Study:
    """Read measurements: a CSV file, or files of testing machines or a folder of them.

    Parameters
    ----------
    path
        A tidy CSV or .csv.gz file, a row per sample: ``time_s``, ``displacement_mm`` and
        ``force_N`` (or ``strain`` and ``stress_kPa``), and what `data.read_measurements` names
        besides; or a file of a layout that its first bytes show (`qlvbayes.io.formats`), or
        several of these, whose tests are one pad's unless the files name others. An InputError
        names file, line and remedy.
    """
    if isinstance(path, str | Path) and not Path(path).is_dir():
        return Study(**vars(read_measurements(path)))
    source = Source.from_files(path)
    if not source.is_complete:
        remedy = "read them one by one"
        raise InputError("several tidy files have pads of their own", remedy=remedy)
    return Study(**vars(source.whole))
