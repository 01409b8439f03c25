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
from qlvbayes.comparison.statistics import fluid_draws, joint_test, smallest_tail
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
    apart = unheld_times(sides)
    shared = [] if apart else shared_constants(sides)
    stated = [*shared, *([] if apart else lasting_shares(sides, shared))]
    every = [*stated, *readings(settings, units)]
    contrasts, lost = _contrasts(groups, every, len(stated), settings, region, seed)
    tested = contrasts[: len(shared)]
    if apart:
        shown = {one.quantity for one in every if one.shown}
        tested = [c for c in contrasts if c.quantity in shown]
        untold = {"answer": "cannot tell", "extrapolated": True}
        contrasts = [c if c.quantity in shown else replace(c, **untold) for c in contrasts]
        # of what all tests show, that which is equal within the region counts as equal
        unequal = [c if c.answer != "equal" else replace(c, direction=0.5) for c in tested]
        omnibus = smallest_tail(unequal, "shown")
    elif between == "fluids":
        omnibus = smallest_tail(tested, "constants")
    else:
        alike = [{c.quantity: group[0].constants[c.quantity] for c in tested} for group in groups]
        omnibus = joint_test(*alike) if tested else None
    comparison = Comparison(
        names=labels, between=between, units=units, specimens=(len(groups[0]), len(groups[1])),
        region=float(region), differ=_differ(omnibus, tested), omnibus=omnibus,
        by_chance=BY_CHANCE * len(contrasts), settings=settings.as_record,
        contrasts=tuple(contrasts),
        notices=tuple(notices(groups, labels, settings, shared, contrasts, lost, apart)),
    )  # fmt: skip
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
    every: Sequence[Reading],
    stated: int,
    settings: ReadingSettings,
    region: float,
    seed: int,
) -> tuple[list[Contrast], list[str]]:
    """Return every contrast, and the quantities that no model could give.

    The models' constants state the first ``stated`` of them; the others are derived.
    """
    rng = np.random.default_rng(seed)
    tables = [
        [
            np.column_stack(
                [*(side.stated(x.quantity) for x in every[:stated]), side.read(settings)]
            )
            for side in group
        ]
        for group in groups
    ]
    pairs = [[rng.permutation(_PAIRS) % len(table) for table in group] for group in tables]
    contrasts, lost = [], []
    for k, reading in enumerate(every):
        columns = [[table[:, k] for table in group] for group in tables]
        if not all(np.all(np.isfinite(x)) for group in columns for x in group):
            lost.append(reading.quantity)
            continue
        if min(map(len, groups)) > 1:
            one, other = fluid_draws(columns, rng)
        else:
            one, other = (group[0][rows[0]] for group, rows in zip(columns, pairs, strict=True))
        contrasts.append(contrast(reading, one, other, region))
    return contrasts, lost


def _differ(omnibus: Omnibus | None, constants: Sequence[Contrast]) -> bool | None:
    """Return True, False where all are shown to be equal, None where the data are undecided."""
    if omnibus is None:
        return None
    if omnibus.p_value < omnibus.false_alarms:
        return True
    return False if all(c.answer == "equal" for c in constants) else None


def contrast(reading: Reading, first: np.ndarray, second: np.ndarray, region: float) -> Contrast:
    """Compare draws (n,) of the first with draws (n,) of the second, independent of each other."""
    ratio = first / second if np.min(first) > 0.0 and np.min(second) > 0.0 else None
    direction = float(np.mean(first > second) + 0.5 * np.mean(first == second))
    # the ratio lies within 1/(1 + region) .. 1 + region; that of two zeros does
    larger = np.maximum(np.abs(first), np.abs(second))
    equivalence = float(np.mean(np.abs(first - second) <= larger * (region / (1.0 + region))))
    ends = None if ratio is None else np.quantile(ratio, [1.0 - DECIDED, DECIDED]).tolist()
    return Contrast(
        quantity=reading.quantity, first=interval(first), second=interval(second),
        unit=reading.unit, difference=interval(first - second),
        ratio=None if ratio is None else interval(ratio), direction=direction,
        equivalence=equivalence, answer=answer(direction, equivalence), group=reading.group,
        extrapolated=reading.extrapolated, ratio95=None if ends is None else tuple(ends),
    )  # fmt: skip


def interval(draws: np.ndarray) -> Interval:
    """Return the median and the central 90 % interval."""
    tail = 0.5 * (1.0 - SHARE)
    low, median, high = np.quantile(draws, [tail, 0.5, 1.0 - tail]).tolist()
    return Interval(median, low, high)


def answer(direction: float, equivalence: float) -> str:
    """Return the answer; what differs only within the region counts as equal."""
    if equivalence >= EQUAL:
        return "equal"
    if direction >= DECIDED:
        return "greater"
    return "less" if direction <= 1.0 - DECIDED else "cannot tell"
