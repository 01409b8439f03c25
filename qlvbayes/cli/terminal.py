"""Show a study on the terminal."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

from msgspec.structs import replace

from qlvbayes.cli import tables
from qlvbayes.cli.console import counting, err, out, waiting
from qlvbayes.cli.look import show_look
from qlvbayes.cli.options import InputOptions
from qlvbayes.diagnosis.phrases import terminal_line
from qlvbayes.diagnosis.result import DiagnosisResult
from qlvbayes.fitting.ensemble import Progress
from qlvbayes.fitting.residuals import CheckResult
from qlvbayes.fitting.summary import FitSummary
from qlvbayes.io.conversion import in_short
from qlvbayes.io.wording import pad_title
from qlvbayes.parallel.running import Shard
from qlvbayes.pipeline.many import Tally
from qlvbayes.pipeline.source import Source
from qlvbayes.pipeline.steps import Watcher
from qlvbayes.report.errors import ErrorTable
from qlvbayes.report.firstlook import FirstLook

_TABLES = 12  # pads; where there are more, each has one line instead of tables


class Terminal(Watcher):
    """Watcher that shows progress and notices on stderr, results on stdout unless ``quiet``."""

    def __init__(self, quiet: bool = False) -> None:
        self.quiet = quiet
        self._noticed: set[str] = set()
        self._prefix = ""  # text before the label of a step, where there are several pads
        self._brief = False
        self._grouping = ""  # which tests are of which pad, until it is printed
        self._began = time.monotonic()

    def reading(self, inputs: InputOptions, part: Shard) -> Source:
        """Return the pads of some files, and print notices on them.

        Which tests are of which pad is printed before the first result, and not where a setting is
        refused.
        """
        source = inputs.source(part)  # may ask, and no spinner may turn then
        self._grouping = source.grouping
        self.notice(*in_short(source.notices))
        return source

    def doing(self, label: str) -> AbstractContextManager[Callable[[str], None]]:
        """Show a spinner."""
        return waiting(f"{self._prefix}{label}")

    def sampling(self, label: str) -> AbstractContextManager[Progress]:
        """Show a progress bar."""
        return counting("steps", f"{self._prefix}{label}")

    @contextmanager
    def overall(self, size: int, *, alone: bool) -> Iterator[Callable[[int, int], None]]:
        """Show a progress bar of pads; in this process, a prefix to the bar of each pad instead."""
        self._brief = size > _TABLES
        if not alone:
            with counting("pads") as report:
                report(0, size)
                yield report
            return
        began = time.monotonic()

        def update(done: int, total: int) -> None:
            left = (time.monotonic() - began) * (total - done) / max(done, 1)
            remaining = f", {_duration(left)} left" if done else ""
            self._prefix = f"{done} of {total} pads done{remaining}: " if done < total else ""

        if size > 1:
            update(0, size)
        yield update
        self._prefix = ""

    def took(self) -> None:
        """Print how long the command took, where progress is told: in a pipe too."""
        if not self.quiet:
            err.print(f"took {_duration(time.monotonic() - self._began)}")

    def notice(self, *texts: str) -> None:
        """Print each notice once: several steps may give the same."""
        for text in texts:
            if text not in self._noticed:
                self._noticed.add(text)
                err.print(f"notice: {text}")

    def looked(self, look: FirstLook, figures: Sequence[Path]) -> None:
        """Print what is in the tests, before anything is fitted."""
        if not self.quiet:
            self._print()
            show_look(replace(look, notices=()), figures)

    def starting(self, lines: Sequence[str]) -> None:
        """Print what is fitted, the noise floor, and the priors."""
        if not self._brief:
            self._print("\n".join(lines), soft_wrap=False)

    def _print(self, *shown: Any, soft_wrap: bool = True) -> None:
        """Print unless quiet; before anything else, which tests are of which pad."""
        if self._grouping and not self.quiet:
            out.print(self._grouping, soft_wrap=True)
        self._grouping = ""
        for one in shown if not self.quiet else ():
            out.print(one, soft_wrap=soft_wrap and isinstance(one, str))

    def fitted(self, summary: FitSummary) -> None:
        """Print the constants, and why the chain has not converged."""
        shown = tables.constants_line if self._brief else tables.constants_table
        self._print(shown(summary))
        for trouble in summary.troubles:
            err.print(f"NOT CONVERGED, pad {summary.pad}: {trouble}", style="bold red")

    def checked(self, check: CheckResult) -> None:
        """Print the errors by test and phase."""
        force, speed = check.units.force, check.units.speed
        table = [] if self._brief else [tables.check_table(check, force, speed)]
        self._print(*table, f"{pad_title(check.pad)}: {ErrorTable(check).in_words(force)}")

    def diagnosed(
        self, result: DiagnosisResult, words: Sequence[str], figures: Sequence[Path]
    ) -> None:
        """Print the steps, the ranking and the verdict in words."""
        if self._brief:
            self._print(terminal_line(result))
            return
        unit = result.units.force
        self._print(tables.steps_table(result, unit), tables.ranking_table(result, unit))
        self._print(*(x for one in words for x in (one, "")), soft_wrap=not out.is_terminal)
        if not self.quiet:
            show_figures(figures)


def _duration(seconds: float) -> str:
    """Return a time as ``40 s``, ``12 min`` or ``3.5 h``."""
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 5400.0 else f"{seconds / 3600.0:.1f} h"


def show_done(folder: Path, done: Tally, leaves: Sequence[str], *, as_json: bool) -> None:
    """Print where the results are, if there are any; for machines the first JSON of each pad."""
    if as_json:
        file = next(name for name in leaves if name.endswith(".json"))
        contents = (json.loads((folder / pad / file).read_bytes()) for pad in done.pads)
        print(json.dumps(list(contents), allow_nan=False))
    elif done.pads:
        out.print(f"results in {folder}")
    elif not done.faults:
        out.print("there are no pads in this part")


def show_figures(figures: Sequence[Path]) -> None:
    """Print where the figures are."""
    out.print("figures:", *(f"  {path}" for path in figures), sep="\n")
