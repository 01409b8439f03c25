"""The rules of the count: what is right, what is wrong, and how sure a rate is.

Named means that the verdict names exactly the hidden effects, without a rival. Grouped means named,
or that the verdict is `ambiguous` and one effect of its own `group`, of at most three, completes
its other effects to exactly the hidden ones; a longer group does not count.

Some names are true though no effect of that name was hidden, and count neither as wanted nor as
wrong: ``contact_offset`` where the platen starts above the pad, and ``extra_relaxation_mode`` where
the base law has fewer modes than the pad.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Any

from scipy.stats import beta

Case = dict[str, Any]
"""A finished study, with the keys that `blind.case` writes."""

LARGEST_GROUP = 3  # effects: a longer list singles nothing out
LEVEL = 0.95  # of the one-sided bounds
_SURE = ("missing_effect", "partly_explained")
_OPEN = ("unexplained", "partly_explained")


@dataclass(frozen=True)
class Rate:
    """Number of hits among n studies, with their share."""

    hits: int
    n: int

    @classmethod
    def from_cases(cls, cases: Iterable[Case], hit: Callable[[Case], bool]) -> Rate:
        """Count the cases for which ``hit`` is true."""
        hits = [hit(case) for case in cases]
        return cls(sum(hits), len(hits))

    @property
    def share(self) -> float | None:
        """Hits over n; None without studies."""
        return self.hits / self.n if self.n else None

    @property
    def error(self) -> float | None:
        """Binomial standard error sqrt(p (1 - p)/n), p = (hits + 1)/(n + 2), never 0."""
        share = (self.hits + 1.0) / (self.n + 2.0)
        return sqrt(share * (1.0 - share) / self.n) if self.n else None

    def as_dict(self) -> dict:
        """Return plain values for JSON."""
        return {"hits": self.hits, "n": self.n, "share": self.share, "standard_error": self.error}

    def __str__(self) -> str:
        if self.share is None or self.error is None:
            return "-"
        return f"{100 * self.share:.1f} ± {100 * self.error:.1f} %"


def is_named(case: Case) -> bool:
    """Return whether exactly the hidden effects are named, or none and the verdict is `adequate`.

    Together with an unlisted effect the listed one is to be named; alone it leaves nothing to name.
    """
    wanted, named = _listed(case), _named(case)
    if case["kind"] == "none":
        gap_alone = case["verdict"] == "missing_effect" and not named
        return bool(case["verdict"] == "adequate" or gap_alone)
    if case["kind"] == "outside":
        return case["verdict"] in _OPEN and not named
    return case["verdict"] in _SURE and named == wanted


def is_grouped(case: Case) -> bool:
    """Return whether the hidden effects are named, or in an ambiguous group of at most three."""
    if is_named(case):
        return True
    if case["verdict"] != "ambiguous" or len(case["group"]) > LARGEST_GROUP:
        return False
    sure = _named(case | {"effects": case["effects"][:-1]})
    return bool(_listed(case)) and _listed(case) in [{*sure, rival} for rival in case["group"]]


def names_kin(case: Case) -> bool:
    """Return whether exactly one effect is named, and the hidden form may be called by it."""
    (name,) = case["names"]
    named = _named(case)
    return case["verdict"] in _SURE and len(named) == 1 and named <= set(case["kin"][name])


def names_wrongly(case: Case) -> bool:
    """Return whether an effect that is not hidden is named without a rival."""
    return case["verdict"] in _SURE and not _named(case) <= _allowed(case)


def true_names(case: Case) -> set[str]:
    """Return the effects that are present: hidden, of a hidden form's physics, or true anyway."""
    return _allowed(case) | _true_anyway(case)


def _allowed(case: Case) -> set[str]:
    """Return the names that a correct verdict may give the hidden effects."""
    if case["kind"] in ("single", "double"):
        return set(case["names"])
    return set().union(*(set(kin) for kin in case["kin"].values()))


def is_unexplained(case: Case) -> bool:
    """Return whether structure is found and no effect is named for it."""
    return bool(case["verdict"] == "unexplained")


def has_failed(case: Case) -> bool:
    """Return whether the program stopped with an error."""
    return bool(case["verdict"] == "failed")


def is_right(case: Case) -> bool:
    """Return whether the verdict is right, by the kind of what is hidden."""
    return names_kin(case) if case["kind"] == "form" else is_grouped(case)


def _listed(case: Case) -> set[str]:
    """Return the hidden effects that are listed ones."""
    return {name for name in case["names"] if name in case["kin"][name]}


def _named(case: Case) -> set[str]:
    """Return the effects that the verdict names, less those that are true but were not hidden."""
    return set(case["effects"]) - (_true_anyway(case) - set(case["names"]))


def _true_anyway(case: Case) -> set[str]:
    """Return the rig's own gap, and a mode that the selected base law lacks."""
    names = set()
    if case.get("rig", {}).get("gap_mm", 0.0) > 0.0:
        names.add("contact_offset")
    if _modes(case.get("strata", {}).get("relaxation")) > _modes(_base(case)) > 0:
        names.add("extra_relaxation_mode")
    return names


def _base(case: Case) -> str | None:
    """Return the relaxation law of the selected base model."""
    relaxation: str | None = case.get("base", {}).get("relaxation")
    return relaxation


def _modes(relaxation: str | None) -> int:
    """Return the number of modes of a Prony series; 0 of another law."""
    law, _, modes = (relaxation or "").partition(":")
    return int(modes) if law == "prony" else 0


@dataclass(frozen=True)
class Count:
    """Question that is counted over the studies of some kinds; good: whether more is better."""

    name: str
    kinds: tuple[str, ...]
    hit: Callable[[Case], bool]
    words: str
    good: bool


_ALL = ("none", "single", "double", "form", "outside", "outside_beside")
COUNTS = (
    Count("none_adequate", ("none",), is_named, "nothing hidden: adequate", True),
    Count("false_name", ("none",), names_wrongly, "nothing hidden: an effect named", False),
    Count("none_unexplained", ("none",), is_unexplained, "nothing hidden: unexplained", False),
    Count("single_named", ("single",), is_named, "one effect: named", True),
    Count("single_group", ("single",), is_grouped, "one effect: named or in the group", True),
    Count("double_named", ("double",), is_named, "two effects: both named", True),
    Count("double_group", ("double",), is_grouped, "two effects: both named or in the group", True),
    Count("form_kin", ("form",), names_kin, "other form: an effect of its family named", True),
    Count("outside_open", ("outside",), is_named, "unlisted effect: nothing named", True),
    Count(
        "beside_named", ("outside_beside",), is_named,
        "unlisted effect with a listed one: that one named", True,
    ),
    Count("wrong", _ALL, names_wrongly, "all: a name that is not hidden, without a rival", False),
    Count("unexplained", _ALL, is_unexplained, "all: unexplained", False),
    Count("failed", _ALL, has_failed, "all: the program stopped", False),
    Count("right", _ALL, is_right, "all: right by kind", True),
)  # fmt: skip


def counted(cases: Sequence[Case], count: Count) -> Rate:
    """Return the rate of one question, over the studies of its kinds that could be seen."""
    some = [c for c in cases if c["kind"] in count.kinds and c.get("seen", False)]
    return Rate.from_cases(some, count.hit)


def lower(rate: Rate) -> float:
    """Return the one-sided 95 % lower bound of a share (Clopper and Pearson 1934)."""
    if rate.hits == 0:
        return 0.0
    return float(beta.ppf(1.0 - LEVEL, rate.hits, rate.n - rate.hits + 1))


def upper(rate: Rate) -> float:
    """Return the one-sided 95 % upper bound of a share (Clopper and Pearson 1934)."""
    if rate.hits == rate.n:
        return 1.0
    return float(beta.ppf(LEVEL, rate.hits + 1, rate.n - rate.hits))


def bound(rate: Rate, good: bool) -> float:
    """Return the unfavourable bound: the lower one of what is good, the upper of what is bad."""
    return lower(rate) if good else upper(rate)
