"""The wide population: which protocol, law, history, noise, logger and hidden effect come where."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qlvbayes.simulate import FOREIGN, FORMS, FURTHER, HIDDEN, OUTSIDE
from qlvbayes.simulate.laws import ELASTIC, RELAXATION
from qlvbayes.simulate.loadcell import CELLS
from qlvbayes.simulate.programmes import PROTOCOL_NAMES

KINDS = ("none", "single", "double", "form", "outside", "outside_beside")
"""Hidden: nothing, one listed effect, two, another form of one, an outsider alone, or an outsider
beside a listed effect."""
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
_PER_TEST = ("slip", "rezeroed")  # drawn anew where a test begins; carried tests are one motion


@dataclass(frozen=True)
class WideItem:
    """One place of the population: a level of each stratum, and what is hidden by name."""

    index: int
    levels: dict[str, str]
    names: tuple[str, ...]


@dataclass(frozen=True)
class Population:
    """Studies of one seed, without end; the one at `index` depends on seed and index only.

    Of the first n studies every level of a stratum with k levels has n/k, rounded up or down; the
    strata are crossed at random.
    """

    seed: int

    @property
    def key(self) -> str:
        """A name that tells this population from others."""
        return f"wide-seed{self.seed}"

    def item(self, index: int) -> WideItem:
        """What is at one place."""
        levels = {name: self._level(name, STRATA[name], index) for name in STRATA}
        return WideItem(index, levels, self._names(levels, index))

    def rng(self, index: int) -> np.random.Generator:
        """Source of all that is random in one study."""
        return np.random.default_rng([self.seed, index, *b"wide study"])

    def _level(self, name: str, levels: Sequence[str], index: int) -> str:
        """Blocks of all levels, each block in an order of its own."""
        block, place = divmod(index, len(levels))
        order = np.random.default_rng([self.seed, block, *name.encode()]).permutation(len(levels))
        return levels[order[place]]

    def _names(self, levels: dict[str, str], index: int) -> tuple[str, ...]:
        """Hidden effects: every name of a kind equally often, in a shuffled order."""
        kind = levels["kind"]
        before = index // len(KINDS)  # one study of each kind in every block of six
        outside = [*OUTSIDE, *FURTHER]
        if levels["history"] == "carried":
            outside = [name for name in outside if name not in _PER_TEST]
        listed = tuple(HIDDEN)
        first = {
            "none": (),
            "single": listed,
            "double": listed,
            "form": (*FORMS, *FOREIGN),
            "outside": outside,
            "outside_beside": outside,
        }[kind]
        if not first:
            return ()
        names = [self._level(f"{kind} name", tuple(first), before)]
        if kind in ("double", "outside_beside"):
            others = [name for name in listed if name not in {*names, *kin(names[0])}]
            names.append(str(self.rng(index).choice(others)))
        return tuple(names)


def kin(name: str) -> frozenset[str]:
    """Listed effects that a hidden one may be called by: itself, or those a form stands for."""
    forms = {**FORMS, **FOREIGN}
    if name in forms:
        return frozenset(forms[name].family.split("/"))
    if name not in HIDDEN:
        return frozenset()
    families = [set(form.family.split("/")) for form in forms.values()]
    return frozenset({name}.union(*(one for one in families if name in one)))
