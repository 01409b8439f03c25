"""The rules of the count: what is right, what is wrong, and how sure a rate is.

named: the verdict names exactly what is hidden and nothing besides, without a rival. group: named,
or the verdict is `ambiguous` and its own `group`, of at most three, completes what it is sure of to
exactly what is hidden; a longer list beside a wrong name counts for nothing.

Some names are true though nothing of that name was hidden, and count neither as wanted nor as
wrong: ``contact_offset`` where the platen starts above the pad, as it does in the wide population,
and ``extra_relaxation_mode`` on a base law of fewer modes than the pad has.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from scipy.stats import beta

from qlvbayes.evaluation.rate import Case, Rate

LARGEST_GROUP = 3  # effects: a longer list singles nothing out
LEVEL = 0.95  # of the one-sided bounds
_SURE = ("missing_effect", "partly_explained")
_OPEN = ("unexplained", "partly_explained")


def is_named(case: Case) -> bool:
    """Exactly what is hidden is named; of nothing hidden, `adequate` is said.

    Beside an outsider the listed effect is to be named; alone it leaves nothing to name.
    """
    wanted, told = _listed(case), _told(case)
    if case["kind"] == "none":
        gap_alone = case["verdict"] == "missing_effect" and not told
        return bool(case["verdict"] == "adequate" or gap_alone)
    if case["kind"] == "outside":
        return case["verdict"] in _OPEN and not told
    return case["verdict"] in _SURE and told == wanted


def is_grouped(case: Case) -> bool:
    """Named, or in an ambiguous verdict's own group of at most three."""
    if is_named(case):
        return True
    if case["verdict"] != "ambiguous" or len(case["group"]) > LARGEST_GROUP:
        return False
    sure = _told(case | {"effects": case["effects"][:-1]})
    return bool(_listed(case)) and _listed(case) in [{*sure, rival} for rival in case["group"]]


def names_kin(case: Case) -> bool:
    """One effect that the hidden form may be called by is named, and nothing besides."""
    (name,) = case["names"]
    told = _told(case)
    return case["verdict"] in _SURE and len(told) == 1 and told <= set(case["kin"][name])


def names_wrongly(case: Case) -> bool:
    """Something that is not hidden is named without a rival."""
    return case["verdict"] in _SURE and not _told(case) <= _allowed(case)


def true_names(case: Case) -> set[str]:
    """Effects that are there: hidden, of a hidden form's physics, or true besides."""
    return _allowed(case) | _true_besides(case)


def _allowed(case: Case) -> set[str]:
    """What is hidden may be called by."""
    if case["kind"] in ("single", "double"):
        return set(case["names"])
    return set().union(*(set(kin) for kin in case["kin"].values()))


def is_unexplained(case: Case) -> bool:
    """Structure is there and nothing is named for it."""
    return bool(case["verdict"] == "unexplained")


def has_failed(case: Case) -> bool:
    """The program stopped with an error."""
    return bool(case["verdict"] == "failed")


def is_right(case: Case) -> bool:
    """What the answer should be, by what is hidden."""
    return names_kin(case) if case["kind"] == "form" else is_grouped(case)


def _listed(case: Case) -> set[str]:
    """Hidden effects that the list holds."""
    return {name for name in case["names"] if name in case["kin"][name]}


def _told(case: Case) -> set[str]:
    """Effects that the verdict names, less those that are true though they were not hidden."""
    return set(case["effects"]) - (_true_besides(case) - set(case["names"]))


def _true_besides(case: Case) -> set[str]:
    """The rig's own gap, and a mode that the base law told lacks."""
    found = set()
    if case.get("rig", {}).get("gap_mm", 0.0) > 0.0:
        found.add("contact_offset")
    if _modes(case.get("strata", {}).get("relaxation")) > _modes(_base(case)) > 0:
        found.add("extra_relaxation_mode")
    return found


def _base(case: Case) -> str | None:
    """The relaxation that the verdict tells."""
    told: str | None = case.get("base", {}).get("relaxation")
    return told


def _modes(relaxation: str | None) -> int:
    """Of a Prony series; 0 of another law."""
    law, _, modes = (relaxation or "").partition(":")
    return int(modes) if law == "prony" else 0


@dataclass(frozen=True)
class Count:
    """One question, of the studies of some kinds; good: more is better."""

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
    Count("outside_open", ("outside",), is_named, "outsider: left open, nothing named", True),
    Count(
        "beside_named", ("outside_beside",), is_named,
        "outsider beside a listed effect: that one named", True,
    ),
    Count("wrong", _ALL, names_wrongly, "all: a name that is not hidden, without a rival", False),
    Count("unexplained", _ALL, is_unexplained, "all: unexplained", False),
    Count("failed", _ALL, has_failed, "all: the program stopped", False),
    Count("right", _ALL, is_right, "all: right by kind", True),
)  # fmt: skip


def counted(cases: Sequence[Case], count: Count) -> Rate:
    """One question over the studies of its kinds that could be seen."""
    some = [c for c in cases if c["kind"] in count.kinds and c.get("seen", False)]
    return Rate.of(some, count.hit)


def lower(rate: Rate) -> float:
    """One-sided 95 % lower bound of a share (Clopper and Pearson 1934)."""
    if rate.hits == 0:
        return 0.0
    return float(beta.ppf(1.0 - LEVEL, rate.hits, rate.n - rate.hits + 1))


def upper(rate: Rate) -> float:
    """One-sided 95 % upper bound of a share (Clopper and Pearson 1934)."""
    if rate.hits == rate.n:
        return 1.0
    return float(beta.ppf(LEVEL, rate.hits + 1, rate.n - rate.hits))


def bound(rate: Rate, good: bool) -> float:
    """The bound that speaks against us: lower of what is good, upper of what is bad."""
    return lower(rate) if good else upper(rate)
