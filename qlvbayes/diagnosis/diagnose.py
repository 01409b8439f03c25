"""The whole diagnosis of one pad: a search over hypotheses, and what is said of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress

from msgspec.structs import replace

from qlvbayes.diagnosis.result import Sampled, Used
from qlvbayes.diagnosis.search import Search, Tell
from qlvbayes.diagnosis.settings import Settings
from qlvbayes.diagnosis.standing import Enough, Standing
from qlvbayes.diagnosis.telling.summing_up import summed_up
from qlvbayes.diagnosis.telling.verdict import Diagnosis
from qlvbayes.diagnosis.weighed import described
from qlvbayes.diagnosis.workbench import as_chosen, search_of
from qlvbayes.effects.catalogue import EFFECTS
from qlvbayes.effects.effect import AbstractEffect
from qlvbayes.io.runtime import forget_compiled, one_blas_thread
from qlvbayes.model.choices import Choices
from qlvbayes.motion.experiment import Experiment
from qlvbayes.motion.pulling import pull_notices

EVIDENCES = ("laplace", "nested")


def diagnose(
    experiment: Experiment,
    choices: Choices | None = None,
    *,
    kinds: Sequence[type[AbstractEffect]] = EFFECTS,
    settings: Settings | None = None,
    evidence: str = "laplace",
    seed: int = 0,
    tell: Tell = lambda text: None,
    watch: Callable[[Standing], None] = lambda standing: None,
) -> Diagnosis:
    """Say what the model of ``choices`` lacks, a law or effects of ``kinds``, from all tests.

    evidence: ``nested`` samples the plain model and the two best hypotheses again by nested
    sampling, a minute or two each. ``tell`` hears what is being done; ``watch`` sees at each such
    step what is known so far, and may raise `Enough` to end the search there. Raises InputError
    where the noise model is not Gaussian.
    """
    choices = choices or Choices()
    experiment = as_chosen(experiment, choices)
    forget_compiled()
    with one_blas_thread():
        search = search_of(experiment, choices, kinds=kinds, settings=settings, tell=tell)

        def told(text: str) -> None:
            tell(text)
            if standing := Standing.of(search, text):
                watch(standing)

        search.tell = told
        with suppress(Enough):
            search.run()
        found = summed_up(experiment, search, kinds, choices.bonded, tell)
        sampled = nested_audit(search, seed, tell) if evidence == "nested" else ()
    notices = pull_notices(experiment, bonded=choices.bonded, effects=choices.effects)
    space = search.density.space
    result = replace(
        found.result,
        nested=sampled,
        warnings=tuple(str(one) for one in sampled if not one.agrees),
        notices=(*experiment.notices, *notices, *found.result.notices),
        settings=Used(
            thresholds=search.settings,
            seed=seed,
            evidence=evidence,
            elastic=tuple(space.elastic),
            relaxation=tuple(space.relaxation),
            effects=tuple(space.effects),
        ),
    )
    return Diagnosis(result, found.work)


def nested_audit(
    search: Search, seed: int = 0, tell: Tell = lambda text: None, best: int = 2
) -> tuple[Sampled, ...]:
    """Nested sampling of the plain model and the likeliest hypotheses, a minute or two each.

    Under the noise floor alone, without a discrepancy, against Laplace's approximation of the same.
    """
    # here, as few ask for it and blackjax is slow to import
    from qlvbayes.inference.nested_sampling import nested_evidence

    order = sorted(search.modes, key=search.log_posterior, reverse=True)
    found = []
    for hypothesis in dict.fromkeys([search.usual, *order[:best]]):
        tell(f"nested sampling: {described(hypothesis)}")
        weighed = search.modes[hypothesis][0]
        laplace = float(weighed.evidence.by_size[0] - search.density.discrepancy.log_prior[0])
        posterior = weighed.point.own.posterior
        laplace += search.density.log_constant
        sampled = nested_evidence(posterior, seed)
        agrees = abs(laplace - sampled.log_evidence) < 3.0 * sampled.error + 0.5
        told = described(hypothesis), laplace, sampled.log_evidence, sampled.error
        found.append(Sampled(*told, agrees))
    return tuple(found)
