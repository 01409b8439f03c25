"""Which study comes at which place: fixed shares of the kinds, every effect equally often."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from qlvbayes.io.checks import InputError
from qlvbayes.simulate import FORMS, HIDDEN, OUTSIDE

KINDS = {"none": 4, "single": 8, "double": 3, "form": 3, "outside": 2}
"""Studies of each kind among 20: nothing missing, one listed effect, two listed effects, another
form of a listed effect, an effect outside the list."""
PROTOCOLS = ("paper", "mixed")
NOISES = ("correlated", "white")
_BLOCK = sum(KINDS.values())
_ORDER, _SECOND = 1, 2  # tell random streams apart


@dataclass(frozen=True)
class Item:
    """One place in the plan: what is hidden there, by name, and the protocol of the tests."""

    index: int
    kind: str
    names: tuple[str, ...]
    protocol: str


@dataclass(frozen=True)
class Plan:
    """Studies of one seed, without end; the one at ``index`` does not depend on how many are run.

    noise: kind of noise, simulated and fitted; effects: what may be hidden alone.
    """

    seed: int
    noise: str = "correlated"
    effects: tuple[str, ...] = tuple(HIDDEN)

    def __post_init__(self) -> None:
        if self.noise not in NOISES:
            raise InputError(f"no noise {self.noise!r}", remedy=f"use one of {', '.join(NOISES)}")
        unknown = [name for name in self.effects if name not in HIDDEN]
        if unknown or not self.effects:
            raise InputError(
                f"no effect {unknown[0]!r}" if unknown else "no effects",
                remedy=f"use some of {', '.join(HIDDEN)}",
            )

    @property
    def key(self) -> str:
        """A name that tells this plan from others."""
        key = f"{self.noise}-seed{self.seed}"
        if set(self.effects) != set(HIDDEN):
            key += "-" + hashlib.sha256(",".join(self.effects).encode()).hexdigest()[:6]
        return key

    def item(self, index: int) -> Item:
        """What is hidden at one place.

        Kinds follow each other in a fixed pattern of 20. Within a kind, the names are gone through
        in an order that the seed decides, and the protocols alternate such that every name meets
        both.
        """
        kind, order = _kind(index)
        names = self._names(kind)
        place, turn = order % len(names), order // len(names)
        shuffled = np.random.default_rng([self.seed, _ORDER, *kind.encode()]).permutation(names)
        hidden: tuple[str, ...] = (str(shuffled[place]),) if kind != "none" else ()
        if kind == "double":
            hidden = (*hidden, self._second(index, hidden[0]))
        return Item(index, kind, hidden, PROTOCOLS[(place + turn + self.seed) % 2])

    def _names(self, kind: str) -> Sequence[str]:
        return {
            "none": ("none",),
            "single": self.effects,
            "double": tuple(HIDDEN),
            "form": tuple(FORMS),
            "outside": tuple(OUTSIDE),
        }[kind]

    def _second(self, index: int, first: str) -> str:
        """A listed effect of another family."""
        others = [name for name in HIDDEN if name not in family(first)]
        return str(np.random.default_rng([self.seed, _SECOND, index]).choice(others))


def family(name: str) -> frozenset[str]:
    """Listed effects of the same physics: those that one of the other forms may stand for.

    Of a form, the effects it stands for; of an effect outside the list, none.
    """
    if name in OUTSIDE:
        return frozenset()
    if name in FORMS:
        return frozenset(FORMS[name].family.split("/"))
    kin = [set(form.family.split("/")) for form in FORMS.values()]
    return frozenset({name}.union(*(members for members in kin if name in members)))


def _kind(index: int) -> tuple[str, int]:
    """Kind of the study at a place, and how many of this kind came before."""
    block, slot = divmod(index, _BLOCK)
    kind = _pattern()[slot]
    return kind, block * KINDS[kind] + _pattern()[:slot].count(kind)


@cache
def _pattern() -> tuple[str, ...]:
    """Kinds in one block, each as evenly spread as its share allows."""
    pattern: list[str] = []
    for slot in range(1, _BLOCK + 1):
        behind = {k: share * slot / _BLOCK - pattern.count(k) for k, share in KINDS.items()}
        pattern.append(max(behind, key=lambda kind: behind[kind]))
    return tuple(pattern)
