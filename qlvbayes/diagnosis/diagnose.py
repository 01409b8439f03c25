"""The whole diagnosis of one pad: a search over hypotheses, and its summary."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace

from msgspec import structs

from qlvbayes.diagnosis.candidate import described
from qlvbayes.diagnosis.progress import SearchProgress, StopSearch
from qlvbayes.diagnosis.result import Used
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
from qlvbayes.motion.specimen import pull_notices


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
            if progress := SearchProgress.from_search(search, text):
                watch(progress)

        shown = direct_evidence(experiment, choices.bonded)
        search.measured = frozenset(one.effect for one in shown if one.beyond_doubt)
        search.report, search.seed = report_and_watch, seed
        with suppress(StopSearch):
            run_search(search)
        summary = summarize(experiment, search, shown, kinds, choices.bonded, report)
    known = (*choices.effects, *summary.result.effects)
    notices = pull_notices(experiment, bonded=choices.bonded, effects=known)
    result = structs.replace(
        summary.result,
        notices=(*experiment.notices, *notices, *summary.result.notices),
        settings=_used(search, seed),
    )
    return Diagnosis(result, summary.work)


def _used(search: Search, seed: int) -> Used:
    """Return the settings of a search, with the laws and effects that it had to choose from."""
    space = search.density.space
    return Used(
        thresholds=search.settings,
        seed=seed,
        elastic=tuple(space.elastic),
        relaxation=tuple(space.relaxation),
        effects=tuple(space.effects),
    )


def run_search(search: Search) -> None:
    """Run a search to its end."""
    search.begin()
    search.expand_beam()
    sampled: set[Hypothesis] = set()
    while _sample_next(search, sampled):
        pass


def _sample_next(search: Search, sampled: set[Hypothesis]) -> bool:
    """Sample the evidence of the most probable hypothesis that counts and was not sampled yet."""
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
        mode.point.separation.forget()
    if estimate is not None:
        evidence = replace(first.evidence, by_size=estimate.by_size, log=estimate.log)
        best = replace(first, evidence=evidence, log_evidence=estimate.log, error=estimate.error)
        search.modes[hypothesis] = [best, *others]
    return True
