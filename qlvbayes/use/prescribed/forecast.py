"""Posterior forecasts of a program, the force of a displacement or the reverse, and their files."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from qlvbayes.comparison.side import Side, Source, side_of
from qlvbayes.diagnosis.candidate import STIFFNESS
from qlvbayes.io.checks import InputError
from qlvbayes.io.files import write_json, write_whole
from qlvbayes.io.units import UnitSystem, column_name
from qlvbayes.io.wording import percent, plain
from qlvbayes.laws.motion import Motion
from qlvbayes.model.drawn import described_model
from qlvbayes.model.model import Model
from qlvbayes.model.stepping import check_inverse, displacement_from_force, without_inverse
from qlvbayes.use.prescribed.hypotheses import DRAWS, DrawnHypothesis, Hypotheses
from qlvbayes.use.prescribed.program import Program, parse, read_table

_BATCH = 100  # draws run together: of a program of 50 000 points they take 40 MB a mode
_NEAR = 1.05  # of a range, that still counts as inside it
_TABLES = (".csv", ".txt", ".tsv", ".gz")
_MEANINGLESS = 0.5  # relative sd between tests from which every seventh new test has half or twice
# the mean
_CLOCK = (
    "fluid_leak", "force_drift", "levelling_leak", "levelling_drift", "slow_change",
    "offsets_by_test",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Forecast:
    """A program's points (N,), and what each posterior draw (n, N) answers."""

    pad: str
    program: Program  # the prescribed program; times repeat where its rate jumps
    units: UnitSystem
    time: np.ndarray  # times (N,) in s
    given: np.ndarray  # the prescribed displacement or force (N,)
    # the force of a prescribed displacement or the displacement of a prescribed force (n, N)
    answers: np.ndarray
    effects: tuple[str, ...]  # effects in the model, or in one of several
    # sentences on where the program leaves the range that the pad's tests cover
    warnings: tuple[str, ...]
    # hypotheses of a diagnosis whose draws are mixed; empty where the draws are of one model
    averaged: tuple[DrawnHypothesis, ...] = ()

    @property
    def median(self) -> np.ndarray:
        """Median (N,) of the answers."""
        return np.median(self.answers, axis=0)

    def band(self, share: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the ends (N,) of the middle ``share`` of the answers, point by point."""
        low, high = np.quantile(self.answers, [0.5 - 0.5 * share, 0.5 + 0.5 * share], axis=0)
        return low, high


def predict_program(
    source: Source | Hypotheses,
    program: str | Path | Program,
    *,
    draws: int = DRAWS,
    pad: str = "pad",
) -> Forecast:
    """Return the force of a prescribed displacement, or the reverse, draw by draw.

    The specimen is at rest at the beginning. Effects of the fit take part, the rig's too; noise
    does not, so that bands are of what the specimen does, not of what a load cell would write. They
    are those of a new test: where a diagnosis found that stiffness or strengths differ from test to
    test, each draw has its own.

    Parameters
    ----------
    source
        A fit, a results file (`load_results`), draws by the constants' names, or the hypotheses
        that a diagnosis left, which are then averaged over: a mixture of the draws of each in
        proportion to its probability. Of several hypotheses those that do not go step by step are
        left out under a prescribed force, with a warning.
    program
        A CSV file, or text as in "ramp 1.6 mm at 20 mm/s, hold 30 s" or "force 1 N in 0.1 s, hold
        30 s".
    draws
        How many of the posterior, evenly out of all.
    pad
        Name of the pad, for draws by the constants' names, which have none.

    Returns
    -------
    Forecast
        Time (N,) in s and answers (draws, N) in the unit of displacement or force.

    Raises
    ------
    InputError
        The program is not understood; or a force is prescribed and an effect does not go step by
        step, or no displacement has the force.
    """
    averaged = source.hypotheses if isinstance(source, Hypotheses) else ()
    sides = [source.side(one) for one in averaged] if isinstance(source, Hypotheses) else []
    sides = sides or [side_of(source, pad)]  # type: ignore[arg-type]
    given = program if isinstance(program, Program) else _read(program, sides[0].units)
    total = sum(len(side.draws) for side in sides)
    some = [
        side.some(max(round(draws * len(side.draws) / total), 1) if averaged else draws)
        for side in sides
    ]
    new = [_of_a_new_test(side, np.random.default_rng(k)) for k, side in enumerate(some)]
    warnings: list[str] = []
    if averaged and given.quantity == "force":
        new, averaged, warnings = _stepping(new, averaged)
    kept: np.ndarray | slice = slice(None)
    if given.quantity == "force":
        kept = np.append((np.diff(given.time) > 0.0) | (np.diff(given.value) != 0.0), True)
    answers = np.concatenate([_answers(model, given, kept, scale) for model, scale in new])
    effects = tuple(dict.fromkeys(e.name for model, _ in new for e in model.effects))
    time, value = given.time[kept], given.value[kept]
    side = sides[0]
    forecast = Forecast(
        side.name, given, side.units, time, value, answers, effects, (), tuple(averaged)
    )
    warnings += _scattered(side)
    return replace(forecast, warnings=(*warnings, *_warnings(forecast, side)))


def _of_a_new_test(side: Side, rng: np.random.Generator) -> tuple[Model, np.ndarray]:
    r"""Return the draws (n,) with strengths of a new test, and the scale of the force of each.

    .. math:: F = e^a \Big(F_0 + \sum_e e^{b_e - a} F_e\Big), \quad
              a \sim N(0, s_0^2), \quad b_e \sim N(0, s_e^2)

    with the forces F_0 of the base laws and F_e of each effect; s are relative sds between tests.
    """
    stiffness = side.scatter.get(STIFFNESS, 0.0) * rng.normal(size=len(side.draws))
    draws = side.draws.copy()
    for effect in described_model(side.choices).effects:
        name = f"{effect.name}.{next(iter(effect.null))}"
        if side.scatter and name in side.names:
            strength = side.scatter.get(effect.name, 0.0) * rng.normal(size=len(draws))
            draws[:, side.names.index(name)] *= np.exp(strength - stiffness)
    return replace(side, draws=draws).models, np.exp(stiffness)


def _scattered(side: Side) -> list[str]:
    """Return a sentence on what differs between tests, in the likeliest model."""
    if not side.scatter:
        return []
    sizes = [f"{name} by {percent(size)}" for name, size in side.scatter.items()]
    sentence = f"tests of one pad differ ({', '.join(sizes)}, one sd): the bands are of a new test"
    wide = [name for name, size in side.scatter.items() if size >= _MEANINGLESS]
    lost = f"; so much that a mean says little: {', '.join(wide)}" if wide else ""
    return [sentence + lost]


def _stepping(
    new: list[tuple[Model, np.ndarray]], averaged: tuple[DrawnHypothesis, ...]
) -> tuple[list[tuple[Model, np.ndarray]], tuple[DrawnHypothesis, ...], list[str]]:
    """Return those hypotheses that go step by step, and a sentence on the others."""
    able = [not without_inverse(model) for model, _ in new]
    if not any(able):
        check_inverse(new[0][0])
    lost = [str(one) for one, stays in zip(averaged, able, strict=True) if not stays]
    sentence = (
        f"left out, as they allow no displacement to be computed from a force: {', '.join(lost)}"
    )
    return (
        [one for one, stays in zip(new, able, strict=True) if stays],
        tuple(one for one, stays in zip(averaged, able, strict=True) if stays),
        [sentence] if lost else [],
    )


def _answers(
    models: Model, given: Program, kept: np.ndarray | slice, scale: np.ndarray
) -> np.ndarray:
    """Return the answers (n, N) of the draws of one model, whose forces have scales (n,)."""
    if given.quantity == "displacement":
        forces = _batches(_forces, models, given.time, given.value, given.rate)
        return forces * scale[:, None]
    check_inverse(models)
    force = given.value[kept] / scale[:, None]
    answers = _batches(_displacements, (models, force), given.time[kept])
    if lost := int(np.sum(np.any(np.isnan(answers), axis=1))):
        raise InputError(
            f"{lost} of {len(answers)} draws have no displacement with this force",
            remedy="prescribe a smaller force",
        )
    return answers


def _read(program: str | Path, units: UnitSystem) -> Program:
    named = isinstance(program, Path) or Path(program).suffix.lower() in _TABLES
    return read_table(Path(program), units) if named else parse(str(program), units)


def _batches(run, draws: Any, *columns: np.ndarray) -> np.ndarray:  # type: ignore[no-untyped-def]
    count = len(jax.tree.leaves(draws)[0])
    answers = []
    for start in range(0, count, _BATCH):
        # the last batch is filled up, so that one compiled function serves any number
        rows = np.minimum(np.arange(start, start + _BATCH), count - 1)
        some = jax.tree.map(lambda x, rows=rows: x[rows], draws)
        answers.append(np.asarray(run(some, *map(jnp.asarray, columns))))
    return np.concatenate(answers)[:count]


@jax.jit
def _forces(models: Model, time: Array, displacement: Array, speed: Array) -> Array:
    motion = Motion(time, displacement, speed, jnp.zeros_like(time))
    return jax.vmap(lambda model: model.force(motion))(models)


@jax.jit
def _displacements(draws: tuple[Model, Array], time: Array) -> Array:
    return jax.vmap(lambda model, force: displacement_from_force(model, time, force))(*draws)


def _warnings(forecast: Forecast, side: Side) -> Iterator[str]:
    if not side.converged:
        yield f"the sampling of {side.name} did not converge"
    for effect in forecast.effects:
        if effect in _CLOCK:
            yield f"{effect} goes with the clock: this is as in the pad's first test"
    if "conditioning" in forecast.effects:
        yield "conditioning goes with the number of tests: this is as in the pad's first test"
    if "inertia" in forecast.effects:
        yield "inertia is left out: the corners of a program have no acceleration"
    if side.reach is None:
        yield "the tests are not known: whether this lies beyond them cannot be said"
        return
    yield from _beyond(forecast, side)


def _beyond(forecast: Forecast, side: Side) -> Iterator[str]:
    reach, units, program = side.reach, side.units, forecast.program
    assert reach is not None
    moved = program.quantity == "displacement"
    displacement = forecast.given if moved else forecast.median
    lasting = np.diff(forecast.time) > 0.0  # a jump has no speed
    speeds = np.abs(
        program.rate if moved else np.diff(displacement)[lasting] / np.diff(forecast.time)[lasting]
    )
    depth, speed, rest = float(displacement.max()), float(speeds.max()), program.longest_rest
    if program.jumps:
        yield (
            f"it jumps at {program.jumps[0]:.4g} s, and the quickest ramp that was tested took "
            f"{plain(reach.quickest, 2)} s: the force just after the jump is the model's own; "
            "rows with a rise time say how fast the platen is"
        )
    if depth > _NEAR * reach.depth:
        yield (
            f"the depth reaches {plain(depth)} {_unit(units.displacement)}, beyond the "
            f"{plain(reach.depth)} that was tested"
        )
    if not program.jumps and not reach.slowest / _NEAR <= speed <= _NEAR * reach.fastest:
        yield (
            f"the speed reaches {plain(speed)} {_unit(units.speed)}, outside the "
            f"{plain(reach.slowest)} "
            f"to {plain(reach.fastest)} that were tested"
        )
    if rest > _NEAR * reach.hold:
        yield (
            f"it holds for {plain(rest)} s, longer than the {plain(reach.hold)} s that were tested"
        )


def _unit(unit: str) -> str:
    return unit.replace("1/s", "per s") if unit != "1" else "of strain"


BANDS = (0.5, 0.9)
_DIGITS = 9  # more than any rig resolves


def columns(forecast: Forecast) -> dict[str, np.ndarray]:
    """Return time, the prescribed quantity, and median and bands of the answer, (N,) each."""
    units = forecast.units
    displacement = column_name(
        units.displacement_name, "" if units.dimensionless else units.displacement
    )
    load = column_name(units.force_name, units.force)
    moved = forecast.program.quantity == "displacement"
    given, answer = (displacement, load) if moved else (load, displacement)
    table = {"time_s": forecast.time, given: forecast.given, answer: forecast.median}
    for share in BANDS:
        low, high = forecast.band(share)
        table |= {f"{answer}_low{share * 100:.0f}": low, f"{answer}_high{share * 100:.0f}": high}
    return table


def content(forecast: Forecast) -> dict[str, object]:
    """Return the content of prediction.json."""
    return {
        "schema": 1,
        "pad": forecast.pad,
        "program": forecast.program.title,
        "prescribed": forecast.program.quantity,
        "effects": list(forecast.effects),
        "draws": len(forecast.answers),
        "averaged": [
            {
                "base": {"elastic": one.base.elastic, "relaxation": one.base.relaxation},
                "effects": list(one.effects),
                "probability": one.probability,
            }
            for one in forecast.averaged
        ],
        "units": asdict(forecast.units),
        "warnings": list(forecast.warnings),
        "columns": {name: values.tolist() for name, values in columns(forecast).items()},
    }


def write_forecast(folder: Path, forecast: Forecast) -> None:
    """Write prediction.json and prediction.csv."""
    write_json(folder / "prediction.json", content(forecast), indent=None)
    table = columns(forecast)
    rows = [",".join(table)]
    rows += [",".join(f"{x:.{_DIGITS}g}" for x in row) for row in zip(*table.values(), strict=True)]
    write_whole(folder / "prediction.csv", ("\n".join(rows) + "\n").encode())
