"""A study as it is seen on the terminal."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from pathlib import Path

from msgspec.structs import replace

from qlvbayes.cli.console import counting, err, out, waiting
from qlvbayes.cli.look import show_look
from qlvbayes.cli.tables import check_table, constants_table, ranking_table, steps_table
from qlvbayes.diagnosis.telling.verdict import Diagnosis
from qlvbayes.fitting.checked import CheckedPad
from qlvbayes.fitting.ensemble import Progress
from qlvbayes.fitting.summary import FitSummary
from qlvbayes.io.data import Measurements, read_measurements
from qlvbayes.io.wording import plain
from qlvbayes.model.choices import Choices
from qlvbayes.model.parameters import NOT_SAMPLED, described, fields_of
from qlvbayes.pipeline.watcher import Watcher
from qlvbayes.preprocess.experiment import Experiment
from qlvbayes.preprocess.firstlook import FirstLook


class Terminal(Watcher):
    """Progress and notices on stderr; results on stdout, unless ``quiet``."""

    def __init__(self, quiet: bool = False) -> None:
        self.quiet = quiet
        self._noticed: set[str] = set()

    def reading(self, file: Path) -> Measurements:
        """The measurements in a file, and what is to know of them."""
        with waiting("reading"):
            study = read_measurements(file)
        for notice in study.notices:
            self.notice(notice)
        return study

    def doing(self, label: str) -> AbstractContextManager[Callable[[str], None]]:
        """A spinner."""
        return waiting(label)

    def sampling(self, label: str) -> AbstractContextManager[Progress]:
        """A progress bar."""
        return counting("steps", label)

    def notice(self, text: str) -> None:
        """A line, once: several steps may find the same."""
        if text not in self._noticed:
            self._noticed.add(text)
            err.print(f"notice: {text}")

    def looked(self, look: FirstLook, figures: Sequence[Path]) -> None:
        """What is in the tests, before anything is fitted."""
        if not self.quiet:
            show_look(replace(look, notices=()), figures)

    def starting(self, experiment: Experiment, choices: Choices) -> None:
        """What is fitted, the noise floor, and the priors."""
        if self.quiet:
            return
        tests = ", ".join(
            f"{trial.name} ({plain(trial.rate)} {experiment.units.speed})"
            for trial in experiment.with_role("fit")
        )
        floor, unit = experiment.floor, experiment.units.force
        lines = [
            f"pad {experiment.pad}: fitting {tests}",
            f"  noise measured at rest: {floor.total:.3g} {unit} (white {floor.white:.3g}, "
            f"correlated {floor.ou:.3g} {unit} over {floor.memory:.2g} s)",
            "  priors:",
        ]
        parts = choices.build(experiment.scales)
        priors = {k: text for part in parts for k, text in described(fields_of(part)).items()}
        free = [f"    {name} ~ {text}" for name, text in priors.items() if text != NOT_SAMPLED]
        others = [name for name, text in priors.items() if text == NOT_SAMPLED]
        lines += free + [f"    {NOT_SAMPLED}: {', '.join(others)}"] * bool(others)
        out.print("\n".join(lines))

    def fitted(self, summary: FitSummary) -> None:
        """The constants, and what speaks against the chain."""
        if not self.quiet:
            out.print(constants_table(summary))
        for trouble in summary.troubles:
            err.print(f"NOT CONVERGED, pad {summary.pad}: {trouble}", style="bold red")

    def checked(self, checked: CheckedPad) -> None:
        """The errors by test and phase."""
        if not self.quiet:
            units = checked.experiment.units
            out.print(check_table(checked.check, units.force, units.speed))

    def diagnosed(self, found: Diagnosis, figures: Sequence[Path]) -> None:
        """The steps, the ranking, the verdict in words."""
        if self.quiet:
            return
        result = found.result
        out.print(steps_table(result, result.units.force))
        out.print(ranking_table(result, result.units.force))
        for paragraph in found.paragraphs():
            out.print(paragraph, soft_wrap=not out.is_terminal)
            out.print()
        for warning in result.warnings:
            err.print(f"warning: {warning}")
        show_figures(figures)


def show_figures(figures: Sequence[Path]) -> None:
    """Where they are."""
    out.print("figures:", *(f"  {path}" for path in figures), sep="\n")
