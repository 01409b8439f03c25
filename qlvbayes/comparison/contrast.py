"""Results of a comparison: each quantity of both, difference, ratio and answer."""

from __future__ import annotations

from collections.abc import Sequence

from qlvbayes.io.files import Part, Result
from qlvbayes.io.units import PAD, UnitSystem
from qlvbayes.io.wording import with_ends

SHARE = 0.90  # of the draws, that an interval holds
DECIDED = 0.975  # probability of direction at which one is called greater
EQUAL = 0.95  # probability of equivalence at which two are called equal
BY_CHANCE = 2.0 * (1.0 - DECIDED)  # of equal quantities that are called different


class Interval(Part, frozen=True):
    """Median and ends of the central 90 % interval."""

    median: float
    low: float
    high: float


class Contrast(Part, frozen=True):
    """A quantity of two pads or two fluids, with its difference, its ratio and an answer."""

    quantity: str
    first: Interval
    second: Interval
    unit: str
    difference: Interval  # first minus second
    # first over second, None where one of them may be zero or change its sign
    ratio: Interval | None
    direction: float  # probability that the first is greater
    equivalence: float  # probability that the ratio lies within 1/(1 + region) .. 1 + region
    # ``equal`` (equivalence at least 95 %), else ``greater`` or ``less`` (direction at least 97.5 %
    # or at most 2.5 %), else ``cannot tell``
    answer: str
    group: str = "constants"  # kind of quantity
    extrapolated: bool = False  # whether the tests of one of them do not reach so far
    # ends of the central 95 % interval of the ratio: it is clear of 1 where one is called greater
    ratio95: tuple[float, float] | None = None


class Omnibus(Part, frozen=True):
    """The joint test of all shared constants."""

    # statistic, freedom: chi-square and its degrees of freedom (None between fluids, where the
    # smallest probability of a wrong direction is corrected for the number of constants)
    statistic: float | None
    freedom: int
    p_value: float  # probability of so large a difference between equals
    # the level at which they are called different, which is the share of equal pairs so called
    false_alarms: float
    # ``constants``, or ``shown`` where the tests do not hold each other's relaxation times, and
    # what all of them show is tested instead
    over: str = "constants"


class ReadAt(Part, frozen=True, rename={"frequencies": "frequencies_Hz", "hold": "hold_s"}):
    """The depth (mm), rates (mm/s), frequencies (Hz) and hold (s) at which quantities are read."""

    depth: float
    rates: tuple[float, ...]
    frequencies: tuple[float, ...]
    hold: float


class Comparison(Result, frozen=True, kw_only=True):
    """Comparison of two pads or two fluids, quantity by quantity: ``compare.json``.

    names: Names of the first and of the second; between: ``pads``, or ``fluids`` where both have
    two specimens or more; units: Units of displacement and force, those of the first pad;
    specimens: Numbers of specimens of the first and of the second; region: Region of practical
    equivalence: ratios within 1/(1 + region) .. 1 + region count as equal; differ: True where the
    joint test calls the two different; False where it does not and each tested quantity is equal
    within the region; None where the data cannot tell; omnibus: The joint test of the shared
    constants, or of the quantities that all tests show; None where there was nothing to test;
    by_chance: Expected number of quantities that would be called different one by one if all were
    equal; settings: Depth, rates, frequencies and hold at which quantities are read; None where
    none are stated; contrasts: One entry for each quantity, the shared constants first; notices:
    One sentence on each limit of the comparison; words: The answer in sentences.
    """

    names: tuple[str, str]
    between: str
    units: UnitSystem = PAD
    specimens: tuple[int, int] = (1, 1)
    region: float
    differ: bool | None
    omnibus: Omnibus | None = None
    by_chance: float = 0.0
    settings: ReadAt | None = None
    contrasts: tuple[Contrast, ...]
    notices: tuple[str, ...] = ()
    words: tuple[str, ...] = ()

    def __getitem__(self, quantity: str) -> Contrast:
        """Return the contrast of that quantity; KeyError lists the others."""
        for contrast in self.contrasts:
            if contrast.quantity == quantity:
                return contrast
        raise KeyError(f"{quantity} is none of {', '.join(c.quantity for c in self.contrasts)}")

    def of_group(self, group: str) -> Sequence[Contrast]:
        """Return the contrasts of one kind."""
        return [contrast for contrast in self.contrasts if contrast.group == group]


def written(value: Interval) -> tuple[str, str, str]:
    """Format median, low and high as every table does."""
    return with_ends(value.median, value.low, value.high)


def with_interval(value: Interval) -> str:
    """Format as ``1.07 [1.04, 1.10]``."""
    median, low, high = written(value)
    return f"{median} [{low}, {high}]"
