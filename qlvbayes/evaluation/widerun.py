"""Run the studies of the wide population that are not kept yet."""

from __future__ import annotations

from collections.abc import Iterable

from qlvbayes.evaluation.keeping import Kept, code_digest
from qlvbayes.evaluation.population import Population
from qlvbayes.evaluation.run import Tell
from qlvbayes.evaluation.widecase import run_wide


def run_population(
    population: Population,
    kept: Kept,
    indices: Iterable[int],
    tell: Tell = lambda done, total: None,
) -> None:
    """One after the other; each keeps the digest of the code that it was run by."""
    digest = code_digest()
    missing = [index for index in indices if index not in kept.cases]
    tell(0, len(missing))
    for done, index in enumerate(missing, start=1):
        kept.add(run_wide(population, index) | {"code": digest})
        tell(done, len(missing))
