"""Do the third step: find which effect a pad's model lacks and save the verdict."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from qlvbayes.diagnosis.diagnose import diagnose
from qlvbayes.diagnosis.result import DiagnosisResult
from qlvbayes.diagnosis.settings import DiagnosisSettings
from qlvbayes.diagnosis.summary.diagnosis import Diagnosis
from qlvbayes.diagnosis.summary.discrepancy import discrepancy
from qlvbayes.io.data import Measurements, Pad
from qlvbayes.io.files import results_folder, write_whole
from qlvbayes.model.choices import Choices
from qlvbayes.pipeline.watcher import Watcher
from qlvbayes.plots.catalogue import pictures_of, save_figures
from qlvbayes.use.prescribed.hypotheses import FILE as HYPOTHESES
from qlvbayes.use.prescribed.hypotheses import drawn_hypotheses


@dataclass(frozen=True)
class DiagnoseStep:
    """Step that diagnoses a pad, repeated for many pads."""

    name: ClassVar[str] = "diagnose"
    reads: ClassVar[tuple[str, ...]] = ()

    choices: Choices
    seed: int
    thresholds: DiagnosisSettings

    def run(self, folder: Path, study: Measurements, watcher: Watcher) -> None:
        """Diagnose the pad; see `diagnose_into`."""
        diagnose_into(
            folder,
            study.pads[0],
            self.choices,
            seed=self.seed,
            watcher=watcher,
            thresholds=self.thresholds,
        )

    def report_saved(self, folder: Path, watcher: Watcher) -> None:
        """Report the saved verdict."""
        result = DiagnosisResult.read(folder / "diagnosis.json")
        for text in result.notices:
            watcher.notice(text)
        words = (folder / "diagnosis.txt").read_text(encoding="utf-8").strip().split("\n\n")
        figures = [path for path in pictures_of("diagnose", folder) if path.exists()]
        watcher.diagnosed(result, words, figures)


def diagnose_into(
    folder: Path,
    pad: Pad,
    choices: Choices,
    *,
    seed: int,
    watcher: Watcher,
    thresholds: DiagnosisSettings | None = None,
) -> Diagnosis:
    """Diagnose one pad; leave ``diagnosis.json``, ``diagnosis.txt`` and the figures in a folder."""
    with watcher.doing(f"pad {pad.name}") as report:
        report("motion, phases and noise floor")
        experiment = choices.prepare(pad)
        choices.build(experiment.scales)  # a setting that cannot be used leaves nothing behind
        results_folder(folder)
        diagnosis = diagnose(
            experiment,
            choices,
            kinds=choices.candidates,
            settings=thresholds,
            seed=seed,
            report=report,
            watch=lambda progress: watcher.searched(pad.name, progress),
        )
        if diagnosis.result.verdict in ("unexplained", "partly_explained"):
            report("a discrepancy for what is left")
            _write_discrepancy(diagnosis, folder)
        report("writing")
        diagnosis.result.write(folder / "diagnosis.json")
        drawn_hypotheses(diagnosis, choices, seed=seed).write(folder / HYPOTHESES)
        write_whole(folder / "diagnosis.txt", f"{diagnosis.text()}\n".encode())
        figures = save_figures("diagnose", folder, diagnosis)
    for text in diagnosis.result.notices:
        watcher.notice(text)
    watcher.diagnosed(diagnosis.result, diagnosis.paragraphs(), figures)
    return diagnosis


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
