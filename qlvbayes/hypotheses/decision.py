r"""What is said of a posterior over hypotheses: a function of numbers alone.

Each hypothesis H has a log posterior, the probability that something outside the list is beside it
(its discrepancy is larger than the tolerance), and whether what it leaves passes as noise. An
effect's inclusion probability is summed over everything else,

.. math:: P(e) = \sum_{H \ni e} P(H).

An effect is named from 0.9 on; where none alone reaches it, the smallest set that holds one of its
members with 0.95 is the group.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from scipy.special import softmax

Key = TypeVar("Key", bound=Hashable)

VERDICTS = ("adequate", "missing_effect", "ambiguous", "partly_explained", "unexplained")
NAMED = 0.9
"""Inclusion probability from which an effect is named."""
COVERED = 0.95
"""Probability with which a group holds the effect."""
LARGEST = 3
"""Members of a group at most: more is no answer."""


@dataclass(frozen=True)
class Weight:
    """A hypothesis in numbers: base and effects, log posterior, probability of something outside.

    sound: whether what it leaves passes as noise, or is too small to matter; falls: whether tests
    left out are predicted better than without its effects.
    """

    base: tuple[str, str]
    effects: frozenset[str]
    log_posterior: float
    outside: float
    sound: bool
    falls: bool = True


@dataclass(frozen=True)
class Decision:
    """The verdict and what it is made of.

    effects: named, the surest first; group: one of which is there, the likeliest first; inclusion:
    of every effect; base: probability of every base; outside: that something unlisted is there;
    best: place of the likeliest hypothesis.
    """

    verdict: str
    effects: tuple[str, ...]
    group: tuple[str, ...]
    inclusion: dict[str, float]
    base: dict[tuple[str, str], float]
    outside: float
    best: int


def decide(weights: Sequence[Weight]) -> Decision:
    """Of all hypotheses seen."""
    shares = softmax([weight.log_posterior for weight in weights])
    best = int(np.argmax(shares))
    pairs = list(zip(weights, shares.tolist(), strict=True))
    inclusion = _summed((name, p) for w, p in pairs for name in w.effects)
    base = _summed((w.base, p) for w, p in pairs)
    outside = sum(p * w.outside for w, p in pairs)
    top = weights[best]
    named = tuple(
        name
        for name in sorted(inclusion, key=lambda name: -inclusion[name])
        if inclusion[name] >= NAMED and name in top.effects and top.falls
    )
    group = () if outside > 0.5 else _group(pairs, named)
    if not top.sound or outside > 0.5:
        verdict = "partly_explained" if named else "unexplained"
        return Decision(verdict, named, (), inclusion, base, outside, best)
    if group:
        return Decision("ambiguous", named, group, inclusion, base, outside, best)
    verdict = "missing_effect" if named else "adequate"
    return Decision(verdict, named, (), inclusion, base, outside, best)


def _summed(pairs: Iterable[tuple[Key, float]]) -> dict[Key, float]:
    """Probabilities by key, the largest first."""
    found: dict[Key, float] = {}
    for key, share in pairs:
        found[key] = found.get(key, 0.0) + share
    return dict(sorted(found.items(), key=lambda item: -item[1]))


def _group(pairs: Sequence[tuple[Weight, float]], named: tuple[str, ...]) -> tuple[str, ...]:
    """Smallest set of which one is there besides what is named, if something surely is."""
    others = [(weight.effects - set(named), share) for weight, share in pairs]
    if sum(share for rest, share in others if not rest) > 1.0 - NAMED:
        return ()
    group: list[str] = []
    while len(group) < LARGEST:
        held = sum(share for rest, share in others if rest & set(group))
        if held >= COVERED:
            break
        left = _summed((n, share) for rest, share in others if not rest & set(group) for n in rest)
        if not left:
            break
        group.append(next(iter(left)))
    return tuple(group)
