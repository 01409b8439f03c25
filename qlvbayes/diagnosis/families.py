"""Families of effects: the listed law and its other forms, which are told by one name."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import Self

from qlvbayes.effects.effect import AbstractEffect


@dataclass(frozen=True)
class Families:
    """Which candidates are of which family.

    of: family of every candidate by its name, a listed effect's being its own; outside: candidates
    that name nothing, each a family of its own.
    """

    of: dict[str, str]
    outside: frozenset[str] = frozenset()

    @classmethod
    def of_kinds(cls, kinds: Iterable[type[AbstractEffect]]) -> Self:
        """By the facts of the effects' classes."""
        kinds = tuple(kinds)
        return cls(
            {kind.name: kind.family() for kind in kinds},
            frozenset(kind.name for kind in kinds if kind.outside),
        )

    def members(self, family: str) -> list[str]:
        """Candidates of one family."""
        return [name for name, own in self.of.items() if own == family]

    def named(self, effects: Collection[str]) -> dict[str, str]:
        """Of a set of effects, the form in which each family is there; none of what is outside."""
        return {self.of[name]: name for name in sorted(effects) if name not in self.outside}

    def share(self, effect: str) -> float:
        """Of its family's prior probability that a member has.

        The listed law has a half, its other forms together the other; where either is no
        candidate, the others have all.
        """
        family = self.of[effect]
        forms = [name for name in self.members(family) if name != family]
        listed = family in self.of
        whole = 0.5 if listed and forms else 1.0
        return whole if effect == family else whole / len(forms)
