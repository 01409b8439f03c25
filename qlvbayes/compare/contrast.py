"""What a comparison says: each quantity of both, their difference and ratio, and the answer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field

from qlvbayes.units import PAD, UnitSystem

SHARE = 0.90  # of the draws, that an interval holds
DECIDED = 0.975  # probability of direction at which one is called greater
EQUAL = 0.95  # probability of equivalence at which two are called equal
BY_CHANCE = 2.0 * (1.0 - DECIDED)  # of equal quantities that are called different


@dataclass(frozen=True)
class Interval:
    """Median and the ends of the central 90 % interval."""

    median: float
    low: float
    high: float


@dataclass(frozen=True)
class Contrast:
    """One quantity of the first and of the second.

    values: of each; difference: first minus second; ratio: first over second, None where one of
    them may be zero or change its sign; direction: probability that the first is greater;
    equivalence: probability that the ratio lies within 1/(1 + region) .. 1 + region; answer:
    ``equal`` (equivalence at least 95 %), else ``greater`` or ``less`` (direction at least 97.5 %
    or at most 2.5 %), else ``cannot tell``; group: kind of quantity; extrapolated: whether the
    tests of one of them do not reach so far.
    """

    quantity: str
    unit: str
    values: tuple[Interval, Interval]
    difference: Interval
    ratio: Interval | None
    direction: float
    equivalence: float
    answer: str
    group: str = "constants"
    extrapolated: bool = False

    def as_dict(self) -> dict:
        """For JSON."""
        content = asdict(self)
        first, second = content.pop("values")
        return {"quantity": content.pop("quantity"), "first": first, "second": second, **content}


@dataclass(frozen=True)
class Omnibus:
    """The joint test of all shared constants.

    statistic, freedom: chi-square and its degrees of freedom (None between fluids, where the
    smallest probability of a wrong direction is corrected for the number of constants); p_value:
    probability of so large a difference between equals; false_alarms: the level at which they are
    called different, which is the share of equal pairs so called.
    """

    statistic: float | None
    freedom: int
    p_value: float
    false_alarms: float


@dataclass(frozen=True)
class Comparison:
    """All contrasts of two pads or two fluids.

    differ: True where the joint test calls the shared constants different; False where it does not
    and each of them is equal within the region; None where the data cannot tell. specimens: how
    many of each; settings: the depth, rates, frequencies and hold at which quantities were read.
    """

    names: tuple[str, str]
    between: str
    region: float
    contrasts: tuple[Contrast, ...]
    differ: bool | None
    omnibus: Omnibus | None
    notices: tuple[str, ...] = ()
    specimens: tuple[int, int] = (1, 1)
    settings: dict[str, object] = field(default_factory=dict)
    units: UnitSystem = PAD

    def __getitem__(self, quantity: str) -> Contrast:
        """The contrast of that quantity; KeyError lists the others."""
        for contrast in self.contrasts:
            if contrast.quantity == quantity:
                return contrast
        raise KeyError(f"{quantity} is none of {', '.join(c.quantity for c in self.contrasts)}")

    def of_group(self, group: str) -> Sequence[Contrast]:
        """The contrasts of one kind."""
        return [contrast for contrast in self.contrasts if contrast.group == group]

    def as_dict(self) -> dict:
        """The content of ``compare.json`` but for the words."""
        return {
            "schema": 1,
            "names": list(self.names),
            "between": self.between,
            "units": self.units.as_dict(),
            "specimens": list(self.specimens),
            "region": self.region,
            "differ": self.differ,
            "omnibus": None if self.omnibus is None else asdict(self.omnibus),
            "by_chance": BY_CHANCE * len(self.contrasts),
            "settings": self.settings,
            "contrasts": [contrast.as_dict() for contrast in self.contrasts],
            "notices": list(self.notices),
        }
