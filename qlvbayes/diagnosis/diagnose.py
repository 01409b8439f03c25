"""The whole diagnosis of one pad: gate, search, adequacy, verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from qlvbayes.checks import InputError
from qlvbayes.choices import Choices
from qlvbayes.diagnosis.ahead import compile_ahead
from qlvbayes.diagnosis.gate import unmeasured
from qlvbayes.diagnosis.judging import judged
from qlvbayes.diagnosis.protocol import protocol_of
from qlvbayes.diagnosis.remainder import leaves_little
from qlvbayes.diagnosis.samples import Samples
from qlvbayes.diagnosis.search import Path, Tell, search
from qlvbayes.diagnosis.settings import Settings
from qlvbayes.diagnosis.summing_up import summed_up
from qlvbayes.diagnosis.swap import settle
from qlvbayes.diagnosis.verdict import Diagnosis, Sampled
from qlvbayes.effects.catalogue import EFFECTS
from qlvbayes.effects.effect import AbstractEffect
from qlvbayes.experiment import Experiment
from qlvbayes.inference.subset import Ensemble, with_every_effect
from qlvbayes.noise import AbstractGaussian
from qlvbayes.posterior import Posterior
from qlvbayes.pulling import pull_notices
from qlvbayes.runtime import forget_compiled

EVIDENCES = ("laplace", "nested")
COSTLY = ("frame_compliance", "channel_lag")  # they run the law beneath several times


def diagnose(
    experiment: Experiment,
    choices: Choices | None = None,
    *,
    kinds: Sequence[type[AbstractEffect]] = EFFECTS,
    settings: Settings | None = None,
    evidence: str = "laplace",
    seed: int = 0,
    tell: Tell = lambda text: None,
) -> Diagnosis:
    """Say which effect of ``kinds`` the model of ``choices`` lacks, from all tests together.

    evidence: ``nested`` samples ``none`` and the two best hypotheses again by nested sampling, a
    minute or two each. ``tell`` hears what is being done. Raises InputError where the noise model
    is not Gaussian.
    """
    settings = settings or Settings()
    choices = choices or Choices()
    experiment = replace(experiment, rested=choices.rested)
    forget_compiled()
    ensemble = _ensemble(experiment, choices, kinds)
    samples = Samples.of(experiment, ensemble)
    tell("compiling")
    compile_ahead(ensemble, samples)
    protocol = protocol_of(experiment, bonded=choices.bonded)
    hidden = {unseen.effect for unseen in unmeasured(ensemble, protocol)}
    candidates = [name for name in ensemble.candidates if name not in hidden]
    path = search(ensemble, samples, candidates, settings, tell)
    if leaves_little(experiment, ensemble, samples, path.last.point, settings):
        settle(ensemble, samples, path, candidates, settings, tell)
    tell("testing what is left")
    found = judged(experiment, ensemble, samples, path, settings, tell)
    sampled = _nested(ensemble, path, seed, tell) if evidence == "nested" else ()
    notices = pull_notices(experiment, bonded=choices.bonded, effects=choices.effects)
    summed = summed_up(found, protocol, sampled, settings)
    return replace(summed, notices=(*notices, *summed.notices))


def _nested(ensemble: Ensemble, path: Path, seed: int, tell: Tell) -> tuple[Sampled, ...]:
    # here, as few ask for it and blackjax is slow to import
    from qlvbayes.diagnosis.nested_check import nested_check

    found = nested_check(ensemble, path.rounds[0], seed=seed, tell=tell)
    return tuple(Sampled(c.effect, c.laplace, c.log_evidence, c.error) for c in found)


def _ensemble(
    experiment: Experiment, choices: Choices, kinds: Sequence[type[AbstractEffect]]
) -> Ensemble:
    scales = experiment.scales
    model, noise = choices.build(scales)
    if not isinstance(noise, AbstractGaussian):
        raise InputError(
            "the diagnosis needs normal noise", remedy="use --noise correlated or --noise white"
        )
    posterior = Posterior(model, noise, experiment.record(experiment.trials))
    own = [effect.name for effect in model.effects]
    added = tuple(
        kind.default(scales)
        for kind in kinds
        if kind.name not in own and not (choices.bonded and kind.name == "adhesion")
    )
    return with_every_effect(posterior, added, COSTLY)
