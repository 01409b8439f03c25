"""The third step: say which effect a pad's model lacks and leave the verdict on disk."""

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
from qlvbayes.motion.experiment import prepare
from qlvbayes.pipeline.watcher import Watcher
from qlvbayes.use.prescribed.hypotheses import FILE as HYPOTHESES
from qlvbayes.use.prescribed.hypotheses import drawn_hypotheses


@dataclass(frozen=True)
class DiagnoseStep:
    """The diagnosis of a pad as a step for many."""

    name: ClassVar[str] = "diagnose"
    reads: ClassVar[tuple[str, ...]] = ()

    choices: Choices
    evidence: str
    seed: int
    thresholds: DiagnosisSettings

    def run(self, folder: Path, study: Measurements, watcher: Watcher) -> None:
        """Diagnose the pad; see `diagnose_into`."""
        diagnose_into(
            folder,
            study.pads[0],
            self.choices,
            evidence=self.evidence,
            seed=self.seed,
            watcher=watcher,
            thresholds=self.thresholds,
        )

    def tell(self, folder: Path, watcher: Watcher) -> None:
        """Report the verdict."""
        from qlvbayes.plots.diagnosis_files import FIGURES

        result = DiagnosisResult.read(folder / "diagnosis.json")
        for text in result.notices:
            watcher.notice(text)
        words = (folder / "diagnosis.txt").read_text(encoding="utf-8").strip().split("\n\n")
        figures = [folder / f"{name}.png" for name in FIGURES]
        watcher.diagnosed(result, words, [path for path in figures if path.exists()])


def diagnose_into(
    folder: Path,
    pad: Pad,
    choices: Choices,
    *,
    evidence: str,
    seed: int,
    watcher: Watcher,
    thresholds: DiagnosisSettings | None = None,
) -> Diagnosis:
    """Diagnose one pad; leave ``diagnosis.json``, ``diagnosis.txt`` and four figures in a folder.

    ``hypotheses.json`` holds draws of the hypotheses that are left. Where something is left that no
    effect explains, ``discrepancy.csv`` too. Raises InputError where a setting cannot be used or
    nothing can be written.
    """
    with watcher.doing(f"pad {pad.name}") as tell:
        tell("motion, phases and noise floor")
        experiment = prepare(pad, keep_all_readings=choices.keep_all_readings, use=choices.use)
        choices.build(experiment.scales)  # a setting that cannot be used leaves nothing behind
        results_folder(folder)
        found = diagnose(
            experiment,
            choices,
            kinds=choices.candidates,
            settings=thresholds,
            evidence=evidence,
            seed=seed,
            report=tell,
            watch=lambda standing: watcher.searched(pad.name, standing),
        )
        if found.result.verdict in ("unexplained", "partly_explained"):
            tell("a discrepancy for what is left")
            _write_discrepancy(found, folder)
        tell("writing")
        found.result.write(folder / "diagnosis.json")
        drawn_hypotheses(found, choices, seed=seed).write(folder / HYPOTHESES)
        write_whole(folder / "diagnosis.txt", f"{found.text()}\n".encode())
        figures = _figures(found, folder)
    for text in found.result.notices:
        watcher.notice(text)
    watcher.diagnosed(found.result, found.paragraphs(), figures)
    return found


def _write_discrepancy(found: Diagnosis, folder: Path) -> None:
    """Leave the discrepancy of the hypothesis told sample by sample in discrepancy.csv."""
    units, samples = found.result.units, found.work.samples
    lines = [f"test,time_s,discrepancy_mean_{units.force},discrepancy_sd_{units.force}"]
    for trial, rows, band in zip(
        samples.trials, samples.rows, discrepancy(found.work), strict=True
    ):
        values = zip(trial.test.time[rows], band.mean, band.sd, strict=True)
        lines += [f"{trial.name},{t:.6g},{mean:.6g},{sd:.6g}" for t, mean, sd in values]
    write_whole(folder / "discrepancy.csv", ("\n".join(lines) + "\n").encode())


def _figures(found: Diagnosis, folder: Path) -> list[Path]:
    # here, so that the other steps do not wait for matplotlib
    from qlvbayes.plots.diagnosis_files import save_diagnosis_figures

    return save_diagnosis_figures(found, folder)
