"""The ranking's evidence once more, by nested sampling."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from qlvbayes.diagnosis.contest import Round
from qlvbayes.inference.nested import LIVE, nested_evidence
from qlvbayes.inference.subset import Ensemble, Part


@dataclass(frozen=True)
class NestedCheck:
    """One hypothesis of a round: log evidence by Laplace, and by nested sampling with its error."""

    effect: str
    laplace: float
    log_evidence: float
    error: float


def nested_check(
    ensemble: Ensemble,
    first: Round,
    *,
    best: int = 2,
    seed: int = 0,
    live: int = LIVE,
    tell: Callable[[str], None] = lambda text: None,
) -> tuple[NestedCheck, ...]:
    """Nested sampling of ``none`` and of a round's best refitted hypotheses, a minute or two each.

    ``tell`` hears which is being sampled.
    """
    points = {"none": first.base}
    refitted = [c for c in first.contenders if c.point is not None]
    points |= {c.effect: c.point for c in refitted[:best] if c.point is not None}
    found = []
    for name, point in points.items():
        tell(f"nested sampling: {name}")
        posterior = Part.of(ensemble, ensemble.own | point.subset.effects).posterior
        nested = nested_evidence(posterior, seed, live=live)
        found.append(
            NestedCheck(name, float(point.log_evidence), nested.log_evidence, nested.error)
        )
    return tuple(found)
