"""The third question: errors over noise of each model, by test and phase."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, log

from qlvbayes.diagnosis.phrases import model_name
from qlvbayes.fitting.residuals import Cell, CheckResult, over_floor
from qlvbayes.io.wording import capitalized, joined, number, with_unit
from qlvbayes.motion.phases import NAMES

_DARKEST = 10.0  # times the noise, from where on a cell is as dark as can be


@dataclass(frozen=True)
class ErrorTable:
    """The errors of a check by test, the slowest first, and phase, against the noise."""

    check: CheckResult

    @property
    def name(self) -> str:
        """The model's name, as a heading begins with."""
        return capitalized(model_name(self.check.effects))

    @property
    def basis(self) -> str:
        """Words on which tests were fitted, and which are predicted."""
        fitted = {cell.test for cell in self.check.cells if cell.role == "fit"}
        if fitted and {cell.test for cell in self.check.cells} - fitted:
            return f"fitted to {joined(sorted(fitted))}, the other tests predicted"
        return "all tests fitted" if fitted else "all tests predicted"

    @property
    def phases(self) -> list[str]:
        """Kinds of phase that occur."""
        return [phase for phase in NAMES if any(cell.phase == phase for cell in self.check.cells)]

    @property
    def rows(self) -> list[dict[str, Cell]]:
        """Cells of each test by phase, slowest first, tests without a rate last."""
        tests: dict[str, dict[str, Cell]] = {}
        for cell in sorted(self.check.cells, key=lambda c: inf if c.rate is None else c.rate):
            tests.setdefault(cell.test, {})[cell.phase] = cell
        return list(tests.values())

    def over(self, cell: Cell) -> str:
        """Return a cell's error over the noise."""
        ratio = over_floor(cell, self.check.noise)
        return f"{ratio:.1f}" if ratio < 100.0 else f"{ratio:.0f}"

    def shade(self, cell: Cell) -> float:
        """Return how dark a cell is, 0 to 1, even in the logarithm as in the figures."""
        ratio = min(max(over_floor(cell, self.check.noise), 1.0), _DARKEST)
        return round(log(ratio) / log(_DARKEST), 2)

    def in_words(self, unit: str) -> str:
        """Return in a sentence where the model fails."""
        cells, worst, noise = self.check.cells, self.check.worst, self.check.noise
        head = f"{self.name}, {self.basis}:"
        if worst is None:
            largest, above = max(cells, key=lambda cell: cell.rmse), ""
            if largest.limit is not None:
                limit = with_unit(number(largest.limit, 2, zeros=True), unit)
                above = f"; it would fail above {limit}"
            return (
                f"{head} fails in none of {len(cells)} phases of tests: no error is beyond what "
                "noise and all that the fit leaves open (constants, zeros) can do there. The "
                f"largest is in {where(largest, noise, unit)}{above}."
            )
        bias = with_unit(number(abs(worst.bias), 2, zeros=True), unit)
        side = "above" if worst.bias > 0.0 else "below"
        return (
            f"{head} fails in {len(self.check.failing)} of {len(cells)} phases of tests. It is "
            f"worst in {where(worst, noise, unit)}, where the measured force lies {bias} "
            f"{side} the model on average."
        )


def where(cell: Cell, noise: float, unit: str) -> str:
    """Return 'the ramp of C-100: 0.049 N root mean square (4.7 times the noise)'."""
    return (
        f"the {NAMES.get(cell.phase, cell.phase)} of {cell.test}: "
        f"{with_unit(number(cell.rmse, 2, zeros=True), unit)} root mean square "
        f"({number(over_floor(cell, noise), 2)} times the noise)"
    )


def repeated(check: CheckResult) -> list[tuple[str, str, str, str]]:
    """Return test, phase, errors over noise and biases of phases that a test has several of."""
    rows: dict[tuple[str, str], list[tuple[float, float]]] = {}
    for cycle in check.cycles:
        rows.setdefault((cycle.test, cycle.phase), []).append((cycle.rmse, cycle.bias))
    return [
        (test, NAMES.get(phase, phase), ", ".join(f"{rmse / check.noise:.1f}" for rmse, _ in one),
         ", ".join(number(bias, 2) for _, bias in one))
        for (test, phase), one in rows.items()
    ]  # fmt: skip
