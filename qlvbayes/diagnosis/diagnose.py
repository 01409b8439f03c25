"""The whole diagnosis of one pad: a search over hypotheses, and its summary."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

from qlvbayes.diagnosis.candidate import described
from qlvbayes.diagnosis.decision import Decision, decide
from qlvbayes.diagnosis.search import Report, Search
from qlvbayes.diagnosis.searchsetup import as_chosen, build_search
from qlvbayes.diagnosis.settings import DiagnosisSettings
from qlvbayes.diagnosis.summary.diagnosis import Diagnosis
from qlvbayes.diagnosis.summary.summarizing import summarize
from qlvbayes.effects.catalogue import EFFECTS
from qlvbayes.effects.effect import AbstractEffect
from qlvbayes.inference.forward.hypothesis import Hypothesis
from qlvbayes.inference.importance import CLOSE, sampled_evidence
from qlvbayes.io.runtime import forget_compiled, one_blas_thread
from qlvbayes.model.choices import Choices
from qlvbayes.motion.evidence import direct_evidence
from qlvbayes.motion.experiment import Experiment


class StopSearch(Exception):  # noqa: N818 - it reports no error
    """Exception that the callback ``watch`` of `diagnose` raises to end the search early.

    The diagnosis is then made from the hypotheses that have been evaluated by that time. `diagnose`
    catches the exception, which has no fields.
    """


@dataclass(frozen=True, eq=False)
class SearchProgress:
    """The state of a search that is still running.

    doing: What the search does next, in words; seen: Number of hypotheses evaluated so far; best:
    The most probable hypothesis so far; decision: What the verdict would be now, before the
    selected hypothesis is tested.
    """

    doing: str
    seen: int
    best: Hypothesis
    decision: Decision


def diagnose(
    experiment: Experiment,
    choices: Choices | None = None,
    *,
    kinds: Sequence[type[AbstractEffect]] = EFFECTS,
    settings: DiagnosisSettings | None = None,
    seed: int = 0,
    report: Report = lambda text: None,
    watch: Callable[[SearchProgress], None] = lambda progress: None,
) -> Diagnosis:
    """Return what the model of ``choices`` lacks, a law or effects, from all tests."""
    choices = choices or Choices()
    experiment = as_chosen(experiment, choices)
    forget_compiled()
    with one_blas_thread():
        search = build_search(experiment, choices, kinds=kinds, settings=settings)

        def report_and_watch(text: str) -> None:
            report(text)
            if search.modes:
                decision = decide(search.weights(), search.settings)
                watch(SearchProgress(text, len(search.modes), search.best, decision))

        shown = direct_evidence(experiment, choices.bonded)
        search.measured = frozenset(one.effect for one in shown if one.beyond_doubt)
        search.report, search.seed = report_and_watch, seed
        with suppress(StopSearch):
            run_search(search)
        return summarize(experiment, search, shown, kinds, choices, report)


def run_search(search: Search) -> None:
    """Run a search to its end."""
    search.begin()
    search.expand_beam()
    sampled: set[Hypothesis] = set()
    while len(sampled) < search.breadth.sampled:
        near = search.log_posterior(search.best) - search.breadth.rival
        left = [one for one in search.modes if one not in sampled]
        left = [one for one in left if search.log_posterior(one) > near]
        if not left:
            break
        hypothesis = max(left, key=search.log_posterior)
        sampled.add(hypothesis)
        _sample(search, hypothesis)


def _sample(search: Search, hypothesis: Hypothesis) -> None:
    """Sample the evidence of a hypothesis about its modes by importance."""
    search.report(f"evidence of {described(hypothesis)}")
    first, *others = search.modes[hypothesis]
    pairs = [(one.mode, one.evidence) for one in (first, *others)]
    # the less probable a hypothesis, the less its evidence needs to be known
    gap = search.log_posterior(search.best) - search.log_posterior(hypothesis)
    close = CLOSE * (1.0 + gap)
    estimate = sampled_evidence(search.density, pairs, search.settings.tolerance, close)
    for mode, _ in pairs:
        mode.point.separation.forget()
    if estimate is not None:
        evidence = replace(first.evidence, by_size=estimate.by_size, log=estimate.log)
        best = replace(first, evidence=evidence, log_evidence=estimate.log, error=estimate.error)
        search.modes[hypothesis] = [best, *others]
