"""Are the figures that the documentation quotes of the bundled data those of a fresh run?

The table of the three methods is in docs/paper.md, errors of data/hidden.csv in docs/limits.md.
Prints each figure that is not, and the rows of the table as they should be, and ends with status 1
then.
The notebooks' outputs are compared with fresh ones by their tests.
"""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from results import ROOT

import qlvbayes as q
from qlvbayes.diagnosis.checks.samples import rmse
from qlvbayes.fitting.ensemble import Settings
from qlvbayes.fitting.fit import build_posterior, fit_pad
from qlvbayes.fitting.least_squares import least_squares, without_noise
from qlvbayes.fitting.prediction import predict
from qlvbayes.fitting.summary import Constant
from qlvbayes.io.data import read_measurements
from qlvbayes.model.choices import Choices
from qlvbayes.model.parameters import names
from qlvbayes.motion.experiment import Experiment, prepare
from qlvbayes.pipeline.specimen import Specimen

TABLE = ROOT / "docs" / "paper.md"
ERRORS = ROOT / "docs" / "limits.md"
METHODS = ("emcee", "least-squares", "two-step")
_SAME = 0.05  # of a number: the chain ends elsewhere on another processor
_OF_WIDTH = 0.15  # of an interval, by which the ends of two chains of a thousand draws differ
QUICK = Settings(max_steps=3000)

_ROW = re.compile(
    r"^\| (?P<pad>[A-Z]) \| (?P<name>\S+)(?: \([^)]*\))? \| (?P<truth>[\d.]+) \|", re.M
)
_INTERVAL = re.compile(r"([\d.]+) \(([\d.]+) to ([\d.]+)\)")
_MISSED = re.compile(
    r"Of (\d+) intervals emcee's miss (\w+), those of least squares (\d+), those of two-step (\d+)"
)
FIT = re.compile(
    r"is ([\d.]+) times that of least squares \(([\d.]+) against ([\d.]+) N, noise ([\d.]+) N\)"
)
BEFORE = re.compile(r"on `data/hidden.csv` ([\d.]+) N against ([\d.]+) N")


@dataclass(frozen=True)
class Cell:
    """A quoted median and interval of one constant by one method, and whether it is marked."""

    pad: str
    constant: str
    method: str
    truth: float
    median: float
    low: float
    high: float
    marked: bool

    @property
    def misses(self) -> bool:
        """Return whether the interval does not hold the truth."""
        return not self.low <= self.truth <= self.high

    def agrees(self, own: Constant) -> bool:
        """Return whether it agrees with a fresh one, to what a chain leaves open."""
        fresh = (own.median, *own.hdi90)
        apart = np.abs(np.subtract(fresh, (self.median, self.low, self.high)))
        return bool(np.all(apart <= _OF_WIDTH * (self.high - self.low)))


def cells(text: str) -> list[Cell]:
    """Return the cells of the table of the three methods."""
    found = []
    for row in _ROW.finditer(text):
        quoted = text[row.end() : text.index("\n", row.end())].split("|")[: len(METHODS)]
        for method, part in zip(METHODS, quoted, strict=True):
            numbers = _INTERVAL.search(part)
            if numbers is None:
                raise ValueError(f"no interval in '{part.strip()}'")
            own = map(float, numbers.groups())
            truth, marked = float(row["truth"]), "**" in part
            found.append(Cell(row["pad"], row["name"], method, truth, *own, marked))
    return found


def numbers_of(pattern: re.Pattern[str], text: str) -> list[float]:
    """Return the numbers that a sentence quotes; 'none' is 0."""
    found = pattern.search(re.sub(r"\s+", " ", text))
    if found is None:
        raise ValueError(f"the sentence '{pattern.pattern}' is not there")
    return [0.0 if word == "none" else float(word) for word in found.groups()]


def inconsistent(text: str) -> Iterator[str]:
    """Marks and counts of the table that do not follow from its own numbers."""
    table = cells(text)
    for cell in table:
        if cell.misses != cell.marked:
            yield f"{cell.pad} {cell.constant}, {cell.method}: marked wrongly"
    per_method = [sum(c.misses for c in table if c.method == method) for method in METHODS]
    counted = [len(table) / len(METHODS), *per_method]
    if numbers_of(_MISSED, text) != counted:
        yield f"intervals and misses are {counted}"


def errors(experiment: Experiment, choices: Choices, constants: dict[str, np.ndarray]) -> float:
    """Root mean square of measured minus predicted mean (N), over the tests left out."""
    left = experiment.with_role("validate")
    found = predict(experiment, choices, constants, left)
    return rmse([one.residual for one in found])


def both_errors(experiment: Experiment, choices: Choices) -> tuple[float, float]:
    """On tests left out: of the fit, and of least squares of the same model and samples."""
    found = fit_pad(experiment, choices, settings=QUICK)
    fitted = {name: found.constants[..., k] for k, name in enumerate(found.names)}
    posterior = build_posterior(experiment, choices, found.trials)
    scale = 1.0 / np.sqrt(np.asarray(posterior.record.blocks.count))
    best = least_squares(without_noise(posterior), scale, np.random.default_rng(0)).thetas[0]
    numbers = np.asarray(posterior.constants(jnp.asarray(best)))
    nothing = dict.fromkeys(("noise.white", "noise.ou", "noise.remainder"), np.zeros(1))
    squares = dict(zip(names(posterior), numbers[:, None], strict=True)) | nothing
    squares |= {"noise.tau": np.ones(1), "noise.factor": np.ones(1)}
    return errors(experiment, choices, fitted), errors(experiment, choices, squares)


def _of_table(text: str) -> Iterator[str]:
    """Rows of fresh fits of data/pads.csv by each method, where one of those quoted is apart."""
    pads = read_measurements(ROOT / "data" / "pads.csv").pads
    fresh = {
        (pad.name, method): Specimen(pad).fit(method=method).summary()
        for pad in pads
        for method in METHODS
    }
    apart = {
        (cell.pad, cell.constant)
        for cell in cells(text)
        if not cell.agrees(fresh[cell.pad, cell.method][cell.constant])
    }
    for row in _ROW.finditer(text):
        pad, constant, truth = row["pad"], row["name"], float(row["truth"])
        if (pad, constant) in apart:
            parts = [_written(fresh[pad, method][constant], truth) for method in METHODS]
            yield f"{row[0]} {' | '.join(parts)} | should be the row"


def _written(own: Constant, truth: float) -> str:
    """Median and interval in the table's words, to a thirtieth of the interval or finer."""
    low, high = own.hdi90
    places = max(-math.floor(math.log10((high - low) / 30.0)), 0)
    words = f"{own.median:.{places}f} ({low:.{places}f} to {high:.{places}f})"
    return words if low <= truth <= high else f"**{words}**"


def _of_hidden(text: str) -> Iterator[str]:
    """Fresh errors of data/hidden.csv, by `fit`, by least squares, and by `diagnose`."""
    (pad,) = read_measurements(ROOT / "data" / "hidden.csv").pads
    experiment = prepare(pad)
    fit, squares = both_errors(experiment, Choices())
    yield from _apart(FIT, text, (fit / squares, fit, squares, experiment.floor.total))
    before: float | None = Specimen(pad).diagnose().result.stages[0].heldout_rmse
    bench = q.Bench.from_experiment(experiment)
    *_, least = bench.held_out(bench.first())
    yield from _apart(BEFORE, text, (before, least))


def _apart(pattern: re.Pattern[str], text: str, fresh: tuple[float | None, ...]) -> Iterator[str]:
    for quoted, own in zip(numbers_of(pattern, text), fresh, strict=True):
        if own is None or abs(own - quoted) > _SAME * abs(quoted):
            yield f"'{pattern.pattern}': {quoted} is quoted, {own} found"


def main() -> None:
    table, sentences = (page.read_text(encoding="utf-8") for page in (TABLE, ERRORS))
    wrong = [*inconsistent(table), *_of_table(table), *_of_hidden(sentences)]
    print(
        "\n".join(wrong) or "every figure that the pages quote of the bundled data is found again"
    )
    sys.exit(bool(wrong))


if __name__ == "__main__":
    main()
