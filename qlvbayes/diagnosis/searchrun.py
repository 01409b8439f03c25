"""The course of a whole search: beam, checks for missed modes, sampled evidences."""

from __future__ import annotations

from dataclasses import replace

from qlvbayes.diagnosis.candidate import described
from qlvbayes.diagnosis.crosschecks import MissedModeChecks
from qlvbayes.diagnosis.search import Search
from qlvbayes.inference.forward.hypothesis import Hypothesis
from qlvbayes.inference.importance import CLOSE, sampled_evidence


def run_search(search: Search) -> None:
    """Run a search to its end.

    The beam is expanded until all neighbours of the most probable hypotheses are known. Then the
    checks look for missed modes; as long as they lead to higher ones, the beam goes on from there.
    In the end the evidence of the hypotheses that count is sampled.

    Raises
    ------
    NoFiniteForceError
        No draw of the baseline's priors gives finite forces.
    """
    search.begin()
    search.expand_beam()
    checks = MissedModeChecks(search)
    while not search.ended_early and checks.run():
        search.expand_beam()
    sampled: set[Hypothesis] = set()
    while _sample_next(search, sampled):
        pass


def _sample_next(search: Search, sampled: set[Hypothesis]) -> bool:
    """Sample the evidence of the most probable hypothesis that counts and was not sampled yet.

    Return whether there was one.
    """
    near = search.log_posterior(search.best) - search.breadth.rival
    left = [one for one in search.modes if one not in sampled]
    left = [one for one in left if search.log_posterior(one) > near]
    if not left or len(sampled) >= search.breadth.sampled:
        return False
    hypothesis = max(left, key=search.log_posterior)
    search.report(f"evidence of {described(hypothesis)}")
    sampled.add(hypothesis)
    first, *others = search.modes[hypothesis]
    pairs = [(one.mode, one.evidence) for one in (first, *others)]
    # the less probable a hypothesis, the less its evidence needs to be known
    gap = search.log_posterior(search.best) - search.log_posterior(hypothesis)
    close = CLOSE * (1.0 + gap)
    estimate = sampled_evidence(search.density, pairs, search.settings.tolerance, close)
    for mode, _ in pairs:
        mode.point.separation.forget_but(mode.size)
    if estimate is not None:
        evidence = replace(first.evidence, by_size=estimate.by_size, log=estimate.log)
        best = replace(first, evidence=evidence, log_evidence=estimate.log, error=estimate.error)
        search.modes[hypothesis] = [best, *others]
    return True
