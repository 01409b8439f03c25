"""The whole diagnosis of one pad: a search over hypotheses, and its summary."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace

from msgspec import structs

from qlvbayes.diagnosis.candidate import described
from qlvbayes.diagnosis.crosschecks import MissedModeChecks
from qlvbayes.diagnosis.progress import SearchProgress, StopSearch
from qlvbayes.diagnosis.result import EvidenceComparison, Used
from qlvbayes.diagnosis.search import Report, Search
from qlvbayes.diagnosis.searchsetup import as_chosen, build_search
from qlvbayes.diagnosis.settings import DiagnosisSettings
from qlvbayes.diagnosis.summary.diagnosis import Diagnosis
from qlvbayes.diagnosis.summary.summarizing import summarize
from qlvbayes.effects.catalogue import EFFECTS
from qlvbayes.effects.effect import AbstractEffect
from qlvbayes.inference.evidence import evidence as laplace_evidence
from qlvbayes.inference.forward.hypothesis import Hypothesis
from qlvbayes.inference.importance import CLOSE, sampled_evidence
from qlvbayes.inference.modes import find_mode
from qlvbayes.io.runtime import forget_compiled, one_blas_thread
from qlvbayes.model.choices import Choices
from qlvbayes.motion.experiment import Experiment
from qlvbayes.motion.pulling import pull_notices


def diagnose(
    experiment: Experiment,
    choices: Choices | None = None,
    *,
    kinds: Sequence[type[AbstractEffect]] = EFFECTS,
    settings: DiagnosisSettings | None = None,
    evidence: str = "laplace",
    seed: int = 0,
    report: Report = lambda text: None,
    watch: Callable[[SearchProgress], None] = lambda progress: None,
) -> Diagnosis:
    """Return what the model of ``choices`` lacks, a law or effects, from all tests.

    The evidence ``nested`` also samples the baseline model and the two best hypotheses by nested
    sampling, a minute or two each. ``report`` takes a line of text before each step that takes a
    while, ``watch`` what is known by then; it may raise `StopSearch` to end the search there.
    """
    choices = choices or Choices()
    experiment = as_chosen(experiment, choices)
    forget_compiled()
    with one_blas_thread():
        search = build_search(experiment, choices, kinds=kinds, settings=settings)

        def report_and_watch(text: str) -> None:
            report(text)
            if progress := SearchProgress.from_search(search, text):
                watch(progress)

        search.report, search.seed = report_and_watch, seed
        with suppress(StopSearch):
            run_search(search)
        summary = summarize(experiment, search, kinds, choices.bonded, report)
        sampled = nested_audit(search, seed, report) if evidence == "nested" else ()
    notices = pull_notices(experiment, bonded=choices.bonded, effects=choices.effects)
    result = structs.replace(
        summary.result,
        nested=sampled,
        warnings=tuple(str(one) for one in sampled if not one.agrees),
        notices=(*experiment.notices, *notices, *summary.result.notices),
        settings=_used(search, seed, evidence),
    )
    return Diagnosis(result, summary.work)


def _used(search: Search, seed: int, evidence: str) -> Used:
    """Return the settings of a search, with the laws and effects that it had to choose from."""
    space = search.density.space
    return Used(
        thresholds=search.settings,
        seed=seed,
        evidence=evidence,
        elastic=tuple(space.elastic),
        relaxation=tuple(space.relaxation),
        effects=tuple(space.effects),
    )


def nested_audit(
    search: Search, seed: int = 0, report: Report = lambda text: None, best: int = 2
) -> tuple[EvidenceComparison, ...]:
    """Return evidences by nested sampling next to Laplace's approximation of the same.

    The baseline model and the ``best`` most probable hypotheses are sampled under the noise floor
    alone, without a discrepancy, which takes a minute or two each. Laplace's approximation is about
    the mode under that noise, which may lie elsewhere than the mode with a discrepancy.
    """
    # imported here, as few ask for it and blackjax is slow to import
    from qlvbayes.inference.nested_sampling import nested_evidence

    order = sorted(search.modes, key=search.log_posterior, reverse=True)
    alone = search.density.of_noise_alone
    audit = []
    for hypothesis in dict.fromkeys([search.baseline, *order[:best]]):
        name = described(hypothesis)
        report(f"nested sampling: {name}")
        point = search.modes[hypothesis][0].point
        mode = find_mode(alone, hypothesis, point.theta)
        assert mode is not None  # it is finite at the mode with a discrepancy
        laplace = laplace_evidence(alone, mode.point).log + alone.log_constant
        sampled = nested_evidence(point.own.posterior, seed)
        agrees = abs(laplace - sampled.log_evidence) < 3.0 * sampled.error + 0.5
        audit.append(EvidenceComparison(name, laplace, sampled.log_evidence, sampled.error, agrees))
    return tuple(audit)


def run_search(search: Search) -> None:
    """Run a search to its end.

    The beam is expanded until all neighbours of the most probable hypotheses are known. Then the
    checks look for missed modes; as long as they lead to higher ones, the beam goes on from there.
    In the end the evidence of the hypotheses that count is sampled.

    Raises NoFiniteForceError where no draw of the baseline's priors gives finite forces.
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
