"""Do the first step: sample a pad's posterior and save it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from msgspec.structs import replace

from qlvbayes.fitting.chainstore import remove_chain
from qlvbayes.fitting.ensemble import Settings
from qlvbayes.fitting.fit import SAMPLERS, fit_pad, independent_noise
from qlvbayes.fitting.relaxation import relaxation_report
from qlvbayes.fitting.results import save, to_arviz
from qlvbayes.fitting.summary import FitSummary
from qlvbayes.io.data import Measurements, Pad
from qlvbayes.io.files import results_folder, write_whole
from qlvbayes.io.wording import plain
from qlvbayes.model.choices import Choices
from qlvbayes.model.parameters import NOT_SAMPLED, described, fields_of
from qlvbayes.motion.experiment import Experiment
from qlvbayes.motion.pulling import pull_notices
from qlvbayes.pipeline.watcher import Watcher
from qlvbayes.plots.catalogue import save_figures


@dataclass(frozen=True)
class FitStep:
    """Step that fits a pad, repeated for many pads."""

    name: ClassVar[str] = "fit"
    reads: ClassVar[tuple[str, ...]] = ()

    choices: Choices
    method: str
    all_tests: bool
    settings: Settings

    def run(self, folder: Path, study: Measurements, watcher: Watcher) -> None:
        """Fit the pad; see `fit_into`."""
        fit_into(
            folder,
            study.pads[0],
            study,
            self.choices,
            method=self.method,
            all_tests=self.all_tests,
            settings=self.settings,
            watcher=watcher,
        )

    def report_saved(self, folder: Path, watcher: Watcher) -> None:
        """Report the fit in the folder; see `report_saved_fit`."""
        report_saved_fit(folder, watcher)


def report_saved_fit(folder: Path, watcher: Watcher) -> None:
    """Report the fit that is saved in a folder."""
    summary = FitSummary.read(folder / "summary.json")
    for text in summary.notices:
        watcher.notice(text)
    watcher.fitted(summary)


def fit_into(
    folder: Path,
    pad: Pad,
    study: Measurements,
    choices: Choices,
    *,
    method: str,
    all_tests: bool,
    settings: Settings,
    watcher: Watcher,
) -> FitSummary:
    """Fit one pad; leave posterior, summary, relaxation, pairs and programme in a folder."""
    with watcher.doing(f"pad {pad.name}: motion, phases and noise floor"):
        experiment = choices.prepare(pad, all_tests=all_tests)
    used = choices if method in SAMPLERS else independent_noise(choices, method)
    used.build(experiment.scales)  # a setting that cannot be used leaves nothing behind
    results_folder(folder)
    pulls = pull_notices(experiment, bonded=choices.bonded, effects=choices.effects)
    notices = (*experiment.notices, *pulls)
    for text in notices:
        watcher.notice(text)
    watcher.starting(_starting_lines(experiment, used, sampled=method in SAMPLERS))
    chain = folder / "chain"
    with watcher.sampling(f"pad {pad.name}: {method}") as progress:
        fit = fit_pad(
            experiment, choices, method=method, settings=settings, folder=chain, progress=progress
        )
    summary = fit.summary()
    for text in summary.notices:
        watcher.notice(text)
    summary = replace(summary, notices=(*notices, *summary.notices))
    with watcher.doing(f"pad {pad.name}: writing"):
        tree = to_arviz(
            fit,
            summary,
            source=str(Path(study.source).resolve()),
            sha256=study.sha256,
            all_tests=all_tests,
            seed=settings.seed,
        )
        save(tree, folder / "posterior.nc")
        summary.write(folder / "summary.json")
        if (relaxed := relaxation_report(experiment)) is not None:
            relaxed.write(folder / "relaxation.json")
            write_whole(folder / "relaxation.txt", relaxed.text().encode())
        save_figures("fit", folder, fit, experiment)
    remove_chain(chain)
    watcher.fitted(summary)
    return summary


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
        f"correlated {plain(floor.ou)} {unit} over {plain(floor.memory, 2)} s)",
        f"  priors{'' if sampled else ', from which the starts are drawn'}:",
    ]
    parts = choices.build(experiment.scales)[: 2 if sampled else 1]
    priors = {k: text for part in parts for k, text in described(fields_of(part)).items()}
    free = [f"    {name} ~ {text}" for name, text in priors.items() if text != NOT_SAMPLED]
    others = [name for name, text in priors.items() if text == NOT_SAMPLED]
    lines += free + [f"    {NOT_SAMPLED}: {', '.join(others)}"] * bool(others)
    return tuple(lines)
