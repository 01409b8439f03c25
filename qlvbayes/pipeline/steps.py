"""The steps of one pad: fit, check and diagnosis, each with what it needs and what it leaves.

What is finished is recorded, so that an interrupted run does not repeat it, in small files in
``OUT/.finished``: ``<step>/<pad>.json`` has the digest of what the step was run with and those of
the files that it left, ``failed/<name>.json`` why a pad, or a file that could not be read, has no
results.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from msgspec.structs import replace

from qlvbayes.diagnosis.diagnose import SearchProgress, diagnose
from qlvbayes.diagnosis.result import DiagnosisResult
from qlvbayes.diagnosis.settings import DiagnosisSettings
from qlvbayes.diagnosis.summary.diagnosis import Diagnosis, discrepancy
from qlvbayes.fitting.ensemble import Progress, Settings, remove_chain
from qlvbayes.fitting.fit import SAMPLERS, fit_pad, independent_noise, to_arviz
from qlvbayes.fitting.relaxation import relaxation_report
from qlvbayes.fitting.residuals import CheckResult, check_pad, curves
from qlvbayes.fitting.results import load, save
from qlvbayes.fitting.summary import FitSummary, pulled
from qlvbayes.io.data import Measurements
from qlvbayes.io.files import DESCRIBED, results_folder, write_json, write_whole
from qlvbayes.io.wording import plain
from qlvbayes.model.choices import Choices
from qlvbayes.model.parameters import NOT_SAMPLED, described, fields_of
from qlvbayes.motion.experiment import Experiment
from qlvbayes.motion.specimen import pull_notices
from qlvbayes.parallel.running import Fault
from qlvbayes.plots.catalogue import figures_of, pictures_of, save_figures
from qlvbayes.report.collect import facts_of
from qlvbayes.report.firstlook import FirstLook
from qlvbayes.use.prescribed.hypotheses import FILE as HYPOTHESES
from qlvbayes.use.prescribed.hypotheses import drawn_hypotheses

PLAIN = "plain"
"""Folder, within that of a pad, of the fit and the check that precede the diagnosis."""
FINISHED = ".finished"
FITTED = ("io", "priors", "laws", "effects", "motion", "model", "inference", "fitting")
"""Folders of the package that the numbers of a fit depend on."""
_FAILED = "failed"


class Watcher:
    """Receiver of a report on each step of a study; this class ignores all of them."""

    def doing(self, label: str) -> AbstractContextManager[Callable[[str], None]]:
        """Begin something that takes a while; yield a function that receives details."""
        return nullcontext(lambda *words: None)

    def sampling(self, label: str) -> AbstractContextManager[Progress]:
        """Begin sampling; yield a function that receives the steps done and the steps to do."""
        return nullcontext(lambda *words: None)

    def notice(self, *texts: str) -> None:
        """Receive what the user should know."""

    def looked(self, look: FirstLook, figures: Sequence[Path]) -> None:
        """Receive the first look at the tests, before anything is fitted."""

    def overall(
        self, size: int, *, alone: bool
    ) -> AbstractContextManager[Callable[[int, int], None]]:
        """Begin the work on ``size`` pads; yield a function of the pads done and the pads to do."""
        return nullcontext(lambda *words: None)

    def starting(self, lines: Sequence[str]) -> None:
        """Receive, before a pad is fitted, its tests, the noise floor and the priors in words."""

    def fitted(self, summary: FitSummary) -> None:
        """Receive the summary of a fit."""

    def checked(self, check: CheckResult) -> None:
        """Receive the check of a fit."""

    def searched(self, pad: str, progress: SearchProgress) -> None:
        """Receive the state of the search for the effect that a pad's model lacks."""

    def diagnosed(
        self, result: DiagnosisResult, words: Sequence[str], figures: Sequence[Path]
    ) -> None:
        """Receive the verdict on a pad, its paragraphs in words and its figures."""


@dataclass(frozen=True)
class Step:
    """One step of one pad: a frozen record of its settings, which can be pickled.

    within: Folder within that of the pad; an empty text for the pad's own.
    """

    name: ClassVar[str]
    needs: ClassVar[tuple[str, ...]] = ()  # files in its folder that it reads
    leaves: ClassVar[tuple[str, ...]]  # files that it always writes there
    code: ClassVar[tuple[str, ...]]  # folders of the package that its numbers depend on

    within: str = field(default="", kw_only=True)

    @property
    def label(self) -> str:
        """Name under which it is recorded as finished."""
        return f"{self.within}-{self.name}" if self.within else self.name

    def run(self, folder: Path, study: Measurements, watcher: Watcher) -> None:
        """Do the step for the one pad of ``study``; the watcher receives only its progress."""
        raise NotImplementedError

    def report(self, folder: Path, watcher: Watcher) -> None:
        """Report the results that lie in the folder."""
        raise NotImplementedError


def is_finished(out: Path, step: str, pad: str, key: str, folder: Path) -> bool:
    """Return whether a step was run with the same inputs and all files that it left are there."""
    try:
        record = json.loads(_file(out, step, pad).read_bytes())
        files: dict[str, str] = record["files"]
        same = record["key"] == key
    except (OSError, ValueError, KeyError, TypeError):
        return False
    return same and all(digest_of(folder / name) == sha for name, sha in files.items())


def record_finished(out: Path, step: str, pad: str, key: str, files: dict[str, str]) -> Path:
    """Record that a step is finished, with the digests of the files that it wrote by name."""
    return _recorded(out, step, pad, key=key, files=files)


def record_fault(out: Path, name: str, fault: Fault) -> None:
    """Record why a pad, or a file that could not be read, has no results."""
    _recorded(out, _FAILED, name, fault=fault.text, mendable=fault.mendable, of=fault.of)


def forget_fault(out: Path, name: str) -> None:
    """Delete the fault of an earlier run."""
    with suppress(OSError):
        _file(out, _FAILED, name).unlink()


def faults_in(out: Path) -> list[Fault]:
    """Return the faults that are recorded in a folder and were not mended since."""
    files = sorted((out / FINISHED / _FAILED).glob("*.json"))
    records = [json.loads(file.read_bytes()) for file in files]
    return [Fault(one["fault"], one["mendable"], one["of"]) for one in records]


def digest_of(path: Path) -> str:
    """Return the SHA-256 of a file's content, or an empty text where there is no such file."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return ""


def _recorded(out: Path, step: str, name: str, **content: Any) -> Path:
    file = _file(out, step, name)
    file.parent.mkdir(parents=True, exist_ok=True)
    write_json(file, content)
    return file


def _file(out: Path, step: str, name: str) -> Path:
    return out / FINISHED / step / f"{name}.json"


@dataclass(frozen=True)
class FitStep(Step):
    """Step that samples a pad's posterior; relaxation.json and figures are left where they apply.

    choices: the model; method: way to the constants; all_tests: whether tests that would validate
    are fitted too; settings: those of the sampler.
    """

    name = "fit"
    leaves = ("posterior.nc", "summary.json")
    code = FITTED

    choices: Choices
    method: str = "emcee"
    all_tests: bool = False
    settings: Settings = field(default_factory=Settings)

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
        watcher.notice(*notices)
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
        priors = json.loads(facts_of(folder / "posterior.nc").get("priors", "{}"))
        far = (f"pad {summary.pad}: {text}" for text in pulled(summary, priors))
        watcher.notice(*summary.notices, *far)
        watcher.fitted(summary)


@dataclass(frozen=True)
class CheckStep(Step):
    """Step that predicts every test of a pad from the fit in its folder; it leaves figures too."""

    name = "check"
    needs = ("posterior.nc",)
    leaves = ("check.json", "curves.json")
    code = FITTED

    seed: int = 0

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
        watcher.notice(*check.notices)
        watcher.checked(check)


@dataclass(frozen=True)
class DiagnoseStep(Step):
    """Step that finds which effect a pad's model lacks; it leaves figures too.

    choices: the model to start from; seed: that of the search; thresholds: what a verdict needs.
    """

    name = "diagnose"
    leaves = ("diagnosis.json", "diagnosis.txt", HYPOTHESES)
    code = (*FITTED, "diagnosis", "comparison", "use")

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
            ).typed(study.source, str(folder.parent), str(folder / DESCRIBED))  # fmt: skip
            if diagnosis.result.verdict in ("unexplained", "partly_explained"):
                report("a discrepancy for what is left")
                _write_discrepancy(diagnosis, folder)
            report("writing")
            if law := diagnosis.law_file:
                write_whole(folder / DESCRIBED, law.encode())
            else:  # that of an earlier diagnosis
                (folder / DESCRIBED).unlink(missing_ok=True)
            diagnosis.result.write(folder / "diagnosis.json")
            drawn_hypotheses(diagnosis, self.choices, seed=self.seed).write(folder / HYPOTHESES)
            write_whole(folder / "diagnosis.txt", f"{diagnosis.text()}\n".encode())
            save_figures("diagnose", folder, diagnosis)

    def report(self, folder: Path, watcher: Watcher) -> None:
        """Report the verdict in the folder."""
        result = DiagnosisResult.read(folder / "diagnosis.json")
        watcher.notice(*result.notices)
        words = (folder / "diagnosis.txt").read_text(encoding="utf-8").strip().split("\n\n")
        figures = [path for path in pictures_of("diagnose", folder) if path.exists()]
        watcher.diagnosed(result, words, figures)


def files_of_fit(step: str = "") -> tuple[str, ...]:
    """Return the files that a fit and its check may leave, or those of one of these steps."""
    own = {
        "fit": (*FitStep.leaves, "relaxation.json", "relaxation.txt"),
        "check": CheckStep.leaves,
    }
    steps = [step] if step else list(own)
    figures = (one.name for name in steps for one in figures_of(name))
    files = (file for name in steps for file in own[name])
    return (*files, *(f"{name}.{kind}" for name in figures for kind in ("png", "pdf")))


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
