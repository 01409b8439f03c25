"""The steps of one pad: fit, check and diagnosis, each with what it needs and what it leaves."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Protocol

from msgspec.structs import replace

from qlvbayes.diagnosis.diagnose import diagnose
from qlvbayes.diagnosis.result import DiagnosisResult
from qlvbayes.diagnosis.settings import DiagnosisSettings
from qlvbayes.diagnosis.summary.diagnosis import Diagnosis
from qlvbayes.diagnosis.summary.discrepancy import discrepancy
from qlvbayes.fitting.chainstore import remove_chain
from qlvbayes.fitting.ensemble import Settings
from qlvbayes.fitting.fit import SAMPLERS, fit_pad, independent_noise
from qlvbayes.fitting.pad_check import check_pad, curves
from qlvbayes.fitting.relaxation import relaxation_report
from qlvbayes.fitting.residuals import CheckResult
from qlvbayes.fitting.results import load, save, to_arviz
from qlvbayes.fitting.summary import FitSummary
from qlvbayes.io.data import Measurements
from qlvbayes.io.files import DESCRIBED, results_folder, write_whole
from qlvbayes.io.wording import plain
from qlvbayes.model.choices import Choices
from qlvbayes.model.parameters import NOT_SAMPLED, described, fields_of
from qlvbayes.motion.experiment import Experiment
from qlvbayes.motion.specimen import pull_notices
from qlvbayes.parallel.running import package_digest
from qlvbayes.pipeline.finished import FITTED, digest_of
from qlvbayes.pipeline.watcher import Watcher
from qlvbayes.plots.catalogue import pictures_of, save_figures
from qlvbayes.use.prescribed.hypotheses import FILE as HYPOTHESES
from qlvbayes.use.prescribed.hypotheses import drawn_hypotheses

PLAIN = "plain"
"""Folder, within that of a pad, of the fit and the check that precede the diagnosis."""


class Step(Protocol):
    """One step of one pad: a frozen record of its settings, which can be pickled."""

    name: ClassVar[str]
    needs: ClassVar[tuple[str, ...]]  # files in its folder that it reads
    leaves: ClassVar[tuple[str, ...]]  # files that it always writes there
    code: ClassVar[tuple[str, ...]]  # folders of the package that its numbers depend on

    @property
    def within(self) -> str:
        """Folder within that of the pad; an empty text for the pad's own."""
        ...

    def run(self, folder: Path, study: Measurements, watcher: Watcher) -> None:
        """Do the step for the one pad of ``study``; the watcher receives only its progress."""
        ...

    def report(self, folder: Path, watcher: Watcher) -> None:
        """Report the results that lie in the folder."""
        ...


def label_of(step: Step) -> str:
    """Return the name under which a step is recorded as finished."""
    return f"{step.within}-{step.name}" if step.within else step.name


def key_of(step: Step, folder: Path, study: Measurements, style: dict[str, Any]) -> str:
    """Return the digest of all that a step's results depend on.

    These are its settings, the measurements, the files that it needs, the user's own laws and
    effects, the style of figures, and the code that it computes with; that of figures is not
    among them, so that an edited figure invalidates no fit.
    """
    choices = getattr(step, "choices", None)
    own = [getattr(choices, name, None) for name in ("effects_file", "laws_file")]
    parts = [
        repr(step), study.sha256, str(Path(study.source).resolve()), study.pads[0].name,
        repr(sorted(map(str, style.items()))), package_digest(step.code),
        *(digest_of(Path(file)) for file in own if file),
        *(digest_of(folder / step.within / name) for name in step.needs),
    ]  # fmt: skip
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


@dataclass(frozen=True)
class FitStep:
    """Step that samples a pad's posterior; relaxation.json and figures are left where they apply.

    choices: the model; method: way to the constants; all_tests: whether tests that would validate
    are fitted too; settings: those of the sampler; within: folder within that of the pad.
    """

    name: ClassVar[str] = "fit"
    needs: ClassVar[tuple[str, ...]] = ()
    leaves: ClassVar[tuple[str, ...]] = ("posterior.nc", "summary.json")
    code: ClassVar[tuple[str, ...]] = FITTED

    choices: Choices
    method: str = "emcee"
    all_tests: bool = False
    settings: Settings = field(default_factory=Settings)
    within: str = ""

    def run(self, folder: Path, study: Measurements, watcher: Watcher) -> None:
        """Fit the pad and save the fit; a killed run continues its chain."""
        (pad,) = study.pads
        with watcher.doing(f"pad {pad.name}: motion, phases and noise floor"):
            experiment = self.choices.prepare(pad, all_tests=self.all_tests)
        sampled = self.method in SAMPLERS
        used = self.choices if sampled else independent_noise(self.choices)
        used.build(experiment.scales)  # a setting that cannot be used leaves nothing behind
        results_folder(folder)
        pulls = pull_notices(experiment, bonded=used.bonded, effects=used.effects)
        notices = (*experiment.notices, *pulls)
        for text in notices:
            watcher.notice(text)
        watcher.starting(_starting_lines(experiment, used, sampled=sampled))
        chain = folder / "chain"
        with watcher.sampling(f"pad {pad.name}: {self.method}") as progress:
            fit = fit_pad(
                experiment, self.choices, method=self.method, settings=self.settings,
                folder=chain, progress=progress,
            )  # fmt: skip
        summary = fit.summary()
        summary = replace(summary, notices=(*notices, *summary.notices))
        with watcher.doing(f"pad {pad.name}: writing"):
            tree = to_arviz(
                fit, summary, source=str(Path(study.source).resolve()), sha256=study.sha256,
                all_tests=self.all_tests, seed=self.settings.seed,
            )  # fmt: skip
            save(tree, folder / "posterior.nc")
            summary.write(folder / "summary.json")
            if (relaxed := relaxation_report(experiment)) is not None:
                relaxed.write(folder / "relaxation.json")
                write_whole(folder / "relaxation.txt", relaxed.text().encode())
            save_figures("fit", folder, fit, experiment)
        remove_chain(chain)

    def report(self, folder: Path, watcher: Watcher) -> None:
        """Report the fit in the folder."""
        summary = FitSummary.read(folder / "summary.json")
        for text in summary.notices:
            watcher.notice(text)
        watcher.fitted(summary)


@dataclass(frozen=True)
class CheckStep:
    """Step that predicts every test of a pad from the fit in its folder; it leaves figures too."""

    name: ClassVar[str] = "check"
    needs: ClassVar[tuple[str, ...]] = ("posterior.nc",)
    leaves: ClassVar[tuple[str, ...]] = ("check.json", "curves.json")
    code: ClassVar[tuple[str, ...]] = FITTED

    seed: int = 0
    within: str = ""

    def run(self, folder: Path, study: Measurements, watcher: Watcher) -> None:
        """Check the fit in the folder."""
        saved = load(folder / "posterior.nc")
        with watcher.doing(f"pad {saved.pad}: predicting"):
            checked = check_pad(saved, study.pad(saved.pad), seed=self.seed)
            checked.check.write(folder / "check.json")
            curves(checked).write(folder / "curves.json")
            save_figures("check", folder, checked)

    def report(self, folder: Path, watcher: Watcher) -> None:
        """Report the check in the folder."""
        check = CheckResult.read(folder / "check.json")
        for text in check.notices:
            watcher.notice(text)
        watcher.checked(check)


@dataclass(frozen=True)
class DiagnoseStep:
    """Step that finds which effect a pad's model lacks; it leaves figures too.

    choices: the model to start from; seed: that of the search; thresholds: what a verdict needs.
    """

    name: ClassVar[str] = "diagnose"
    needs: ClassVar[tuple[str, ...]] = ()
    leaves: ClassVar[tuple[str, ...]] = ("diagnosis.json", "diagnosis.txt", HYPOTHESES)
    code: ClassVar[tuple[str, ...]] = (*FITTED, "diagnosis", "comparison", "use")
    within: ClassVar[str] = ""

    choices: Choices
    seed: int = 0
    thresholds: DiagnosisSettings = field(default_factory=DiagnosisSettings)

    def run(self, folder: Path, study: Measurements, watcher: Watcher) -> None:
        """Diagnose the pad and save the verdict."""
        (pad,) = study.pads
        with watcher.doing(f"pad {pad.name}") as report:
            report("motion, phases and noise floor")
            experiment = self.choices.prepare(pad)
            self.choices.build(experiment.scales)  # a bad setting leaves nothing behind
            results_folder(folder)
            diagnosis = diagnose(
                experiment, self.choices, kinds=self.choices.candidates,
                settings=self.thresholds, seed=self.seed, report=report,
                watch=lambda progress: watcher.searched(pad.name, progress),
            )  # fmt: skip
            if diagnosis.result.verdict in ("unexplained", "partly_explained"):
                report("a discrepancy for what is left")
                _write_discrepancy(diagnosis, folder)
            report("writing")
            _write_law(diagnosis.work.law.text, folder / DESCRIBED)
            diagnosis.result.write(folder / "diagnosis.json")
            drawn = drawn_hypotheses(diagnosis, self.choices, seed=self.seed)
            drawn.write(folder / HYPOTHESES)
            write_whole(folder / "diagnosis.txt", f"{diagnosis.text()}\n".encode())
            save_figures("diagnose", folder, diagnosis)

    def report(self, folder: Path, watcher: Watcher) -> None:
        """Report the verdict in the folder."""
        result = DiagnosisResult.read(folder / "diagnosis.json")
        for text in result.notices:
            watcher.notice(text)
        words = (folder / "diagnosis.txt").read_text(encoding="utf-8").strip().split("\n\n")
        figures = [path for path in pictures_of("diagnose", folder) if path.exists()]
        watcher.diagnosed(result, words, figures)


def _write_law(text: str, path: Path) -> None:
    """Write the described law; that of an earlier diagnosis is removed where there is none now."""
    if text:
        write_whole(path, text.encode())
    else:
        path.unlink(missing_ok=True)


def _starting_lines(experiment: Experiment, choices: Choices, *, sampled: bool) -> tuple[str, ...]:
    """Return what is fitted, the noise floor, and the priors."""
    tests = ", ".join(
        f"{trial.name} ({plain(trial.rate)} {experiment.units.speed})"
        for trial in experiment.with_role("fit")
    )
    floor, unit = experiment.floor, experiment.units.force
    lines = [
        f"pad {experiment.pad}: fitting {tests}",
        f"  noise measured at rest: {plain(floor.total)} {unit} (white {plain(floor.white)}, "
        f"correlated {plain(floor.ou)} {unit} over {plain(floor.tau, 2)} s)",
        f"  priors{'' if sampled else ', from which the starts are drawn'}:",
    ]
    parts = choices.build(experiment.scales)[: 2 if sampled else 1]
    priors = {k: text for part in parts for k, text in described(fields_of(part)).items()}
    free = [f"    {name} ~ {text}" for name, text in priors.items() if text != NOT_SAMPLED]
    others = [name for name, text in priors.items() if text == NOT_SAMPLED]
    lines += free + [f"    {NOT_SAMPLED}: {', '.join(others)}"] * bool(others)
    return tuple(lines)


def _write_discrepancy(diagnosis: Diagnosis, folder: Path) -> None:
    """Write the discrepancy of the reported hypothesis to discrepancy.csv, a row per sample."""
    units, samples = diagnosis.result.units, diagnosis.work.samples
    lines = [f"test,time_s,discrepancy_mean_{units.force},discrepancy_sd_{units.force}"]
    for trial, rows, band in zip(
        samples.trials, samples.rows, discrepancy(diagnosis.work), strict=True
    ):
        values = zip(trial.test.time[rows], band.mean, band.sd, strict=True)
        lines += [f"{trial.name},{t:.6g},{mean:.6g},{sd:.6g}" for t, mean, sd in values]
    write_whole(folder / "discrepancy.csv", ("\n".join(lines) + "\n").encode())
