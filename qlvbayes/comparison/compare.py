"""Comparison of two pads or fluids: every constant, and the quantities derived from them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from msgspec.structs import replace

from qlvbayes.comparison.contrast import (
    BY_CHANCE,
    DECIDED,
    EQUAL,
    SHARE,
    Comparison,
    Contrast,
    Interval,
    Omnibus,
)
from qlvbayes.comparison.readings import Reading, ReadingSettings, choose, readings
from qlvbayes.comparison.side import (
    Side,
    Source,
    lasting_shares,
    shared_constants,
    side_of,
    unheld_times,
)
from qlvbayes.comparison.statistics import DRAWS, fluid_draws, joint_test, smallest_tail
from qlvbayes.comparison.words import notices, paragraphs
from qlvbayes.fitting.fit import Fit
from qlvbayes.fitting.results import Saved
from qlvbayes.io.checks import InputError

REGION = 0.10  # of practical equivalence: ratios within 1/1.1 .. 1.1
_PAIRS = 4000


def compare(
    first: Source | Sequence[Source],
    second: Source | Sequence[Source],
    *,
    names: tuple[str, str] | None = None,
    region: float = REGION,
    depth: float | None = None,
    rates: Sequence[float] | None = None,
    frequencies: Sequence[float] | None = None,
    seed: int = 0,
) -> Comparison:
    """Compare two pads, or two groups of specimens.

    The draws of two pads are independent and are paired at random. With two specimens or more of
    each, their spread is estimated with the fluids' own values (normal, in the logarithm of what is
    positive).

    Parameters
    ----------
    first, second
        A `Fit`, a results file (`load_results`) or a dict of draws by the constants' names; or a
        sequence of these, the specimens of one fluid.
    names
        What to call them.
    region
        Of practical equivalence, as a share of the smaller one.
    depth, rates, frequencies
        Where quantities are read (mm, mm/s, or in the first one's units, to which the others are
        converted; Hz); by default where both pads' tests reach.
    seed
        Of the pairing.

    Raises
    ------
    InputError
        The two cannot be compared, or a number is not positive.
    """
    if not (np.isfinite(region) and region > 0.0):
        raise InputError(f"region {region:g} is not above 0", remedy="give a share such as 0.1")
    groups, labels = _groups(first, second, names)
    sides = [*groups[0], *groups[1]]
    units, between = sides[0].units, "fluids" if min(map(len, groups)) > 1 else "pads"
    settings = choose([side.reach for side in sides], depth, rates, frequencies)
    rng = np.random.default_rng(seed)
    apart = unheld_times(sides)
    shared = [] if apart else shared_constants(sides)
    stated = [*shared, *([] if apart else lasting_shares(sides, shared))]
    contrasts, lost = _contrasts(groups, stated, settings, region, between, rng, apart)
    tested = contrasts[: len(shared)]
    if apart:
        observed = {one.quantity for one in readings(settings, units) if one.shown}
        tested = [c for c in contrasts if c.quantity in observed]
    omnibus = _of_shown(tested) if apart else _omnibus(groups, tested, between)
    comparison = Comparison(
        names=labels,
        between=between,
        units=units,
        specimens=(len(groups[0]), len(groups[1])),
        region=float(region),
        differ=_differ(omnibus, tested),
        omnibus=omnibus,
        by_chance=BY_CHANCE * len(contrasts),
        settings=settings.as_record,
        contrasts=tuple(contrasts),
        notices=tuple(notices(groups, labels, settings, shared, contrasts, lost, apart)),
    )
    return replace(comparison, words=tuple(paragraphs(comparison)))


def _groups(
    first: Source | Sequence[Source],
    second: Source | Sequence[Source],
    names: tuple[str, str] | None,
) -> tuple[tuple[list[Side], list[Side]], tuple[str, str]]:
    """Return the specimens of both groups, in the units of the first, and the groups' names."""
    given = names or ("first", "second")
    groups = _sides(first, given[0]), _sides(second, given[1])
    labels = names or (_label(groups[0]), _label(groups[1]))
    sides = [*groups[0], *groups[1]]
    if len({side.units.dimensionless for side in sides}) > 1:
        raise InputError(
            f"{labels[0]} and {labels[1]} are in different units",
            remedy="compare force with force, or stress with stress",
        )
    if min(map(len, groups)) == 1 and len(sides) > 2:
        raise InputError(
            f"{labels[0]} and {labels[1]} have {len(groups[0])} and {len(groups[1])} specimens",
            remedy="give two or more of each, or compare pads",
        )
    one, two = ([side.in_units(sides[0].units) for side in group] for group in groups)
    return (one, two), labels


def _sides(source: Source | Sequence[Source], label: str) -> list[Side]:
    """Return the pads of one side; draws, which have no name, get the label."""
    several = [source] if isinstance(source, (Fit, Saved, Mapping)) else source
    suffixes = [""] if len(several) == 1 else [f" {k}" for k in range(1, len(several) + 1)]
    sides = [side_of(one, f"{label}{n}") for one, n in zip(several, suffixes, strict=True)]
    if not sides:
        raise InputError("nothing to compare", remedy="give at least one fit")
    return sides


def _label(group: Sequence[Side]) -> str:
    return group[0].name if len(group) == 1 else group[0].fluid or group[0].name


def _contrasts(
    groups: tuple[list[Side], list[Side]],
    stated: Sequence[Reading],
    settings: ReadingSettings,
    region: float,
    between: str,
    rng: np.random.Generator,
    apart: Sequence[str],
) -> tuple[list[Contrast], list[str]]:
    """Return every contrast, constants first, and the quantities that no model could give."""
    units = groups[0][0].units
    every = [*stated, *readings(settings, units)]
    tables = [[_table(side, stated, settings) for side in group] for group in groups]
    pairs = [[rng.permutation(_PAIRS) % len(t) for t in group] for group in tables]
    contrasts, lost = [], []
    for k, reading in enumerate(every):
        columns = [[table[:, k] for table in group] for group in tables]
        if not all(np.all(np.isfinite(x)) for group in columns for x in group):
            lost.append(reading.quantity)
            continue
        if between == "fluids":
            one, other = fluid_draws(columns, rng)
        else:
            one, other = (group[0][rows[0]] for group, rows in zip(columns, pairs, strict=True))
        one_of_all = contrast(reading, one, other, region)
        if apart and not reading.shown:
            one_of_all = replace(one_of_all, answer="cannot tell", extrapolated=True)
        contrasts.append(one_of_all)
    return contrasts, lost


def _table(side: Side, stated: Sequence[Reading], settings: ReadingSettings) -> np.ndarray:
    """Return draws (n, Q) of what the models' constants state, and of the derived quantities."""
    columns = [side.stated(reading.quantity) for reading in stated]
    return np.column_stack([*columns, side.read(settings)])


def _omnibus(
    groups: tuple[list[Side], list[Side]], constants: Sequence[Contrast], between: str
) -> Omnibus | None:
    if between == "fluids":
        return smallest_tail(constants, DRAWS)
    names = [c.quantity for c in constants]
    first, second = ({k: group[0].constants[k] for k in names} for group in groups)
    return joint_test(first, second) if names else None


def _of_shown(contrasts: Sequence[Contrast]) -> Omnibus | None:
    """Test the quantities that all tests show; those equal within the region count as equal."""
    unequal = [c if c.answer != "equal" else replace(c, direction=0.5) for c in contrasts]
    omnibus = smallest_tail(unequal, DRAWS)
    return None if omnibus is None else replace(omnibus, over="shown")


def _differ(omnibus: Omnibus | None, constants: Sequence[Contrast]) -> bool | None:
    """Return True, False where all are shown to be equal, None where the data are undecided."""
    if omnibus is None:
        return None
    if omnibus.p_value < omnibus.false_alarms:
        return True
    return False if all(c.answer == "equal" for c in constants) else None


def contrast(reading: Reading, first: np.ndarray, second: np.ndarray, region: float) -> Contrast:
    """Compare draws (n,) of the first with draws (n,) of the second, independent of each other."""
    positive = bool(np.min(first) > 0.0 and np.min(second) > 0.0)
    direction = float(np.mean(first > second) + 0.5 * np.mean(first == second))
    equivalence = float(np.mean(alike(first, second, region)))
    return Contrast(
        quantity=reading.quantity,
        first=interval(first),
        second=interval(second),
        unit=reading.unit,
        difference=interval(first - second),
        ratio=interval(first / second) if positive else None,
        direction=direction,
        equivalence=equivalence,
        answer=answer(direction, equivalence),
        group=reading.group,
        extrapolated=reading.extrapolated,
        ratio95=_decisive(first / second) if positive else None,
    )


def _decisive(ratios: np.ndarray) -> tuple[float, float]:
    """Return the ends between which the ratio lies with the probability that decides."""
    low, high = np.quantile(ratios, [1.0 - DECIDED, DECIDED])
    return float(low), float(high)


def interval(draws: np.ndarray) -> Interval:
    """Return the median and the central 90 % interval."""
    tail = 0.5 * (1.0 - SHARE)
    low, median, high = np.quantile(draws, [tail, 0.5, 1.0 - tail])
    return Interval(float(median), float(low), float(high))


def alike(first: np.ndarray, second: np.ndarray, region: float) -> np.ndarray:
    """Return whether the ratio lies within 1/(1 + region) .. 1 + region; two zeros do."""
    larger = np.maximum(np.abs(first), np.abs(second))
    return np.abs(first - second) <= larger * (region / (1.0 + region))


def answer(direction: float, equivalence: float) -> str:
    """Return the answer; what differs only within the region counts as equal."""
    if equivalence >= EQUAL:
        return "equal"
    if direction >= DECIDED:
        return "greater"
    return "less" if direction <= 1.0 - DECIDED else "cannot tell"
