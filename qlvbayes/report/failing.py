"""The third question: where the model fails, by test and phase."""

from __future__ import annotations

from dataclasses import dataclass

from qlvbayes.diagnosis.phrases import model_name
from qlvbayes.fitting import residuals
from qlvbayes.fitting.residuals import CheckResult
from qlvbayes.io.wording import capitalized, joined, number, percent_unbroken, with_unit
from qlvbayes.motion.phases import NAMES
from qlvbayes.report.collect import PadResults

_DARKEST = 5.0  # times the noise, from where on a cell is as dark as can be


@dataclass(frozen=True)
class MapCell:
    """Error over noise in one phase of one test, and how dark it is (0 to 1)."""

    ratio: str
    shade: float
    fails: bool


@dataclass(frozen=True)
class TestRow:
    """A test: its rate, its role, and a cell for each phase (None where it has none)."""

    test: str
    rate: str
    role: str
    cells: tuple[MapCell | None, ...]


@dataclass(frozen=True)
class Map:
    """Error over noise of one model, test by test and phase by phase."""

    title: str
    phases: tuple[str, ...]
    rows: tuple[TestRow, ...]


@dataclass(frozen=True)
class Detail:
    """A row of the table of all errors."""

    test: str
    phase: str
    role: str
    rate: str
    n: str
    rmse: str
    ratio: str
    bias: str
    coverage: str
    fails: bool


@dataclass(frozen=True)
class Repeated:
    """A kind of phase that a test has several of: error over noise and bias, one by one."""

    test: str
    phase: str
    ratios: str
    biases: str


@dataclass(frozen=True)
class Failing:
    """Errors of one pad's model by test and phase: in words, as maps, as a table."""

    pad: str
    words: tuple[str, ...]
    maps: tuple[Map, ...]
    details: tuple[Detail, ...]
    repeated: tuple[Repeated, ...]
    noise: str
    force_unit: str
    speed_unit: str


def failing_of(pad: PadResults) -> Failing | None:
    """Return the results of the check; None where it was not done."""
    check = pad.final.check
    if check is None:
        return None
    models = [(pad.final, check)]
    if pad.baseline and pad.baseline.check and pad.baseline.effects != pad.final.effects:
        models.insert(0, (pad.baseline, pad.baseline.check))
    return Failing(
        pad.name,
        tuple(_words(model_name(model.effects), result, pad) for model, result in reversed(models)),
        tuple(_map(model_name(model.effects), result) for model, result in models),
        tuple(_detail(cell, check.noise) for cell in check.cells),
        _repeated(check),
        number(check.noise),
        pad.force_unit,
        pad.speed_unit,
    )


def where(cell: residuals.Cell, noise: float, unit: str) -> str:
    """Return 'the ramp of C-100: 0.049 N root mean square (4.7 times the noise)'."""
    return (
        f"the {NAMES.get(cell.phase, cell.phase)} of {cell.test}: "
        f"{with_unit(number(cell.rmse, 2, zeros=True), unit)} root mean square "
        f"({number(cell.rmse / noise, 2)} times the noise)"
    )


def _words(name: str, check: CheckResult, pad: PadResults) -> str:
    noise, cells = check.noise, check.cells
    head = f"{capitalized(name)}:"
    fitted = {cell.test for cell in cells if cell.role == "fit"}
    rest = {cell.test for cell in cells} - fitted
    basis = f"fitted to {joined(sorted(fitted))}, the other tests predicted" * bool(fitted and rest)
    basis = basis or ("all tests fitted" if fitted else "all tests predicted")
    worst = check.worst
    if worst is None:
        largest = max(cells, key=lambda cell: cell.rmse)
        return (
            f"{head} no phase of any test is off by more than noise ({basis}). The largest error "
            f"is in {where(largest, noise, pad.force_unit)}."
        )
    bias = with_unit(number(abs(worst.bias), 2, zeros=True), pad.force_unit)
    side = "above" if worst.bias > 0.0 else "below"
    return (
        f"{head} fails in {len(check.failing)} of {len(cells)} phases of tests ({basis}). It is "
        f"worst in {where(worst, noise, pad.force_unit)}, where the measured force lies {bias} "
        f"{side} the model on average."
    )


def _map(name: str, check: CheckResult) -> Map:
    phases = [p for p in NAMES if any(cell.phase == p for cell in check.cells)]
    by_test: dict[str, dict[str, residuals.Cell]] = {}
    for cell in check.cells:
        by_test.setdefault(cell.test, {})[cell.phase] = cell
    return Map(
        capitalized(name),
        tuple(NAMES[phase] for phase in phases),
        tuple(
            TestRow(
                test,
                number(next(iter(cells.values())).rate),
                next(iter(cells.values())).role,
                tuple(_cell(cells.get(phase), check.noise) for phase in phases),
            )
            for test, cells in by_test.items()
        ),
    )


def _cell(cell: residuals.Cell | None, noise: float) -> MapCell | None:
    if cell is None:
        return None
    ratio = cell.rmse / noise
    shade = min(max((ratio - 1.0) / (_DARKEST - 1.0), 0.0), 1.0)
    text = f"{ratio:.1f}" if ratio < 100.0 else f"{ratio:.0f}"
    return MapCell(text, round(shade, 2), cell.fails)


def _detail(cell: residuals.Cell, noise: float) -> Detail:
    return Detail(
        cell.test,
        NAMES.get(cell.phase, cell.phase),
        "fitted" if cell.role == "fit" else "predicted",
        number(cell.rate),
        str(cell.n),
        number(cell.rmse, zeros=True),
        f"{cell.rmse / noise:.2f}",
        number(cell.bias, 2),
        percent_unbroken(cell.coverage90),
        cell.fails,
    )


def _repeated(check: CheckResult) -> tuple[Repeated, ...]:
    """Return a row a test and kind of phase; results of older versions have none."""
    rows: dict[tuple[str, str], list[residuals.Cycle]] = {}
    for cycle in check.cycles:
        rows.setdefault((cycle.test, cycle.phase), []).append(cycle)
    return tuple(
        Repeated(
            test,
            NAMES.get(phase, phase),
            ", ".join(f"{cycle.rmse / check.noise:.1f}" for cycle in cycles),
            ", ".join(number(cycle.bias, 2) for cycle in cycles),
        )
        for (test, phase), cycles in rows.items()
    )
