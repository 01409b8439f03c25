"""The population of blind studies: which strata and which hidden effects each study has."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from blind.catalogue import FOREIGN, FORMS
from blind.disturbed import RECORDS
from blind.laws import ELASTIC, RELAXATION
from blind.lists import FIRST, PRESENT, Lists
from blind.loadcell import CELLS
from blind.programmes import PROTOCOL_NAMES
from qlvbayes.io.checks import InputError, check_known
from qlvbayes.simulate import HIDDEN

KINDS = ("none", "single", "double", "form", "outside", "outside_beside")
"""Hidden: nothing, one listed effect, two, another form of one, an unlisted effect alone, or an
unlisted effect together with a listed one."""
STRATA: dict[str, tuple[str, ...]] = {
    "kind": KINDS,
    "protocol": PROTOCOL_NAMES,
    "elastic": tuple(ELASTIC),
    "relaxation": tuple(RELAXATION),
    "history": ("rested", "carried"),
    "noise": CELLS,
    "logger": ("full", "uniform", "thinned"),
}
"""Every stratum's levels; each level comes equally often, in an order of its own."""
RECORD = "record"
_PLAIN = 8  # of 13 studies in a row have a plain record, and one each a disturbed one: 8 %
PAPER_STRATA: dict[str, tuple[str, ...]] = STRATA | {
    "protocol": ("paper", "one_retraction"),
    "elastic": ("exponential",),
    "relaxation": ("prony:2",),
    "history": ("rested",),
    "noise": ("usual",),
    "logger": ("thinned",),
}
"""The levels that the paper's rig and pads have."""
NOISE_LEVELS = {"correlated": "usual", "white": "white"}
"""Levels of the stratum ``noise`` of the paper's strata, by the name that the user gives."""
_PER_TEST = ("slip", "rezeroed", "cracking_skin", "rolling_specimen")
"""Drawn anew where a test begins; carried tests are one motion."""


@dataclass(frozen=True)
class Item:
    """Level of each stratum and names of the hidden effects of one study."""

    index: int
    levels: dict[str, str]
    names: tuple[str, ...]


@dataclass(frozen=True)
class Population:
    """Studies of one seed, without end; each depends on the seed and its own index only.

    Of the first n studies every level of a stratum with k levels has n/k, rounded up or down; the
    strata are crossed at random.

    Parameters
    ----------
    seed
        Seed of everything that is random in the studies.
    paper
        Whether the strata are those of the paper's rig and pads alone.
    noise
        Kind of noise of the paper's strata: ``correlated`` or ``white``.
    effects
        Names of the listed effects that may be hidden alone.
    disturbed
        Whether 8 % of the studies each have lost readings, late starts, unequal holds, noise that
        changes along a test, or holds under a force (stratum ``record``). What is random in these
        has streams of its own: the plain records are those of the same population without.
    lists
        The names of what may be hidden.

    Raises
    ------
    InputError
        There is no such kind of noise or no such effect.
    """

    seed: int
    paper: bool = False
    noise: str = "correlated"
    effects: tuple[str, ...] = PRESENT.listed
    disturbed: bool = False
    lists: Lists = PRESENT

    def __post_init__(self) -> None:
        check_known("noise", self.noise, NOISE_LEVELS)
        unknown = [name for name in self.effects if name not in self.lists.listed]
        if unknown or not self.effects:
            raise InputError(
                f"no effect {unknown[0]!r}" if unknown else "no effects",
                remedy=f"use some of {', '.join(self.lists.listed)}",
            )

    @property
    def key(self) -> str:
        """Name that identifies this population."""
        key = f"paper-{self.noise}-seed{self.seed}" if self.paper else f"wide-seed{self.seed}"
        if self.disturbed:
            key += "-disturbed"
        if self.lists != FIRST:
            key += f"-lists{_digest((*self.lists.listed, *self.lists.forms, *self.lists.outside))}"
        if set(self.effects) != set(self.lists.listed):
            key += f"-{_digest(self.effects)}"
        return key

    @property
    def strata(self) -> dict[str, tuple[str, ...]]:
        """Levels of each stratum."""
        strata = PAPER_STRATA | {"noise": (NOISE_LEVELS[self.noise],)} if self.paper else STRATA
        return strata | {RECORD: RECORDS} if self.disturbed else strata

    def item(self, index: int) -> Item:
        """Return the strata and hidden effects of one study."""
        strata = self.strata
        if self.disturbed:
            strata = strata | {RECORD: (*RECORDS[:1] * _PLAIN, *RECORDS[1:])}
        levels = {name: self._level(name, some, index) for name, some in strata.items()}
        return Item(index, levels, self._names(levels, index))

    def rng(self, index: int) -> np.random.Generator:
        """Return the generator of everything that is random in one study."""
        return np.random.default_rng([self.seed, index, *b"wide study"])

    def record_rng(self, index: int) -> np.random.Generator:
        """Return the generator of what is random in the disturbance of a study's record."""
        return np.random.default_rng([self.seed, index, *b"disturbed record"])

    def _level(self, name: str, levels: Sequence[str], index: int) -> str:
        """Level of one stratum; they come in blocks of all levels, each block in its own order."""
        block, position = divmod(index, len(levels))
        order = np.random.default_rng([self.seed, block, *name.encode()]).permutation(len(levels))
        return levels[order[position]]

    def _names(self, levels: dict[str, str], index: int) -> tuple[str, ...]:
        """Names of the hidden effects; every name of a kind comes equally often."""
        kind = levels["kind"]
        before = index // len(KINDS)  # one study of each kind in every block of six
        outside = self.lists.outside
        if levels["history"] == "carried":
            outside = tuple(name for name in outside if name not in _PER_TEST)
        listed = self.lists.listed
        first = {
            "none": (),
            "single": self.effects,
            "double": listed,
            "form": self.lists.forms,
            "outside": outside,
            "outside_beside": outside,
        }[kind]
        if not first:
            return ()
        names = [self._level(f"{kind} name", first, before)]
        if kind in ("double", "outside_beside"):
            others = [name for name in listed if name not in {*names, *kin(names[0])}]
            names.append(str(self.rng(index).choice(others)))
        return tuple(names)


def _digest(names: Sequence[str]) -> str:
    return hashlib.sha256(",".join(names).encode()).hexdigest()[:6]


def kin(name: str) -> frozenset[str]:
    """Return the effects that a correct verdict may name: the hidden, or what a form replaces."""
    forms = {**FORMS, **FOREIGN}
    if name in forms:
        return frozenset(forms[name].family.split("/"))
    if name not in HIDDEN:
        return frozenset()
    families = [set(form.family.split("/")) for form in forms.values()]
    return frozenset({name}.union(*(one for one in families if name in one)))
