"""The third question: errors over noise of each model, by test and phase."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, log

from qlvbayes.diagnosis.phrases import model_name
from qlvbayes.fitting.residuals import Cell, CheckResult
from qlvbayes.io.wording import capitalized, joined, number, with_unit
from qlvbayes.motion.phases import NAMES

_DARKEST = 10.0  # times the noise, from where on a cell is as dark as can be


@dataclass(frozen=True)
class ErrorTable:
    """The errors of one model by test, the slowest first, and phase, against the noise.

    ``basis`` says which tests were fitted. A cell fails by the one rule of `CheckResult`.
    """

    effects: tuple[str, ...]
    noise: float
    cells: tuple[Cell, ...]
    basis: str

    @classmethod
    def of_check(cls, check: CheckResult) -> ErrorTable:
        """Return the errors of a check: some tests fitted, the others predicted."""
        fitted = {cell.test for cell in check.cells if cell.role == "fit"}
        rest = {cell.test for cell in check.cells} - fitted
        basis = "all tests fitted" if fitted else "all tests predicted"
        if fitted and rest:
            basis = f"fitted to {joined(sorted(fitted))}, the other tests predicted"
        return cls(tuple(check.effects), check.noise, check.cells, basis)

    @property
    def name(self) -> str:
        """The model's name, as a heading begins with."""
        return capitalized(model_name(self.effects))

    @property
    def failing(self) -> list[Cell]:
        """Cells with more than noise."""
        return [cell for cell in self.cells if cell.fails]

    @property
    def worst(self) -> Cell | None:
        """The failing cell with the largest error; None where none fails."""
        return max(self.failing, key=lambda cell: cell.rmse, default=None)

    @property
    def phases(self) -> list[str]:
        """Kinds of phase that occur."""
        return [phase for phase in NAMES if any(cell.phase == phase for cell in self.cells)]

    @property
    def rows(self) -> list[dict[str, Cell]]:
        """Cells of each test by phase, slowest first, tests without a rate last."""
        tests: dict[str, dict[str, Cell]] = {}
        for cell in sorted(self.cells, key=lambda c: inf if c.rate is None else c.rate):
            tests.setdefault(cell.test, {})[cell.phase] = cell
        return list(tests.values())

    def over(self, cell: Cell) -> str:
        """Return a cell's error over the noise."""
        ratio = cell.rmse / self.noise
        return f"{ratio:.1f}" if ratio < 100.0 else f"{ratio:.0f}"

    def shade(self, cell: Cell) -> float:
        """Return how dark a cell is, 0 to 1, even in the logarithm as in the figures."""
        ratio = min(max(cell.rmse / self.noise, 1.0), _DARKEST)
        return round(log(ratio) / log(_DARKEST), 2)

    def in_words(self, unit: str) -> str:
        """Return in a sentence where the model fails."""
        head = f"{self.name}, {self.basis}:"
        worst = self.worst
        if worst is None:
            largest = max(self.cells, key=lambda cell: cell.rmse)
            limit = largest.limit
            above = "" if limit is None else (
                f"; it would fail above {with_unit(number(limit, 2, zeros=True), unit)}"
            )  # fmt: skip
            return (
                f"{head} fails in none of {len(self.cells)} phases of tests: no error is beyond "
                "what noise and all that the fit leaves open (constants, zeros) can do there. The "
                f"largest is in {where(largest, self.noise, unit)}{above}."
            )
        bias = with_unit(number(abs(worst.bias), 2, zeros=True), unit)
        side = "above" if worst.bias > 0.0 else "below"
        return (
            f"{head} fails in {len(self.failing)} of {len(self.cells)} phases of tests. It is "
            f"worst in {where(worst, self.noise, unit)}, where the measured force lies {bias} "
            f"{side} the model on average."
        )


def where(cell: Cell, noise: float, unit: str) -> str:
    """Return 'the ramp of C-100: 0.049 N root mean square (4.7 times the noise)'."""
    return (
        f"the {NAMES.get(cell.phase, cell.phase)} of {cell.test}: "
        f"{with_unit(number(cell.rmse, 2, zeros=True), unit)} root mean square "
        f"({number(cell.rmse / noise, 2)} times the noise)"
    )


def repeated(check: CheckResult) -> list[tuple[str, str, str, str]]:
    """Return test, phase, errors over noise and biases of phases that a test has several of."""
    rows: dict[tuple[str, str], list[tuple[float, float]]] = {}
    for cycle in check.cycles:
        rows.setdefault((cycle.test, cycle.phase), []).append((cycle.rmse, cycle.bias))
    return [
        (
            test,
            NAMES.get(phase, phase),
            ", ".join(f"{rmse / check.noise:.1f}" for rmse, _ in one),
            ", ".join(number(bias, 2) for _, bias in one),
        )
        for (test, phase), one in rows.items()
    ]
