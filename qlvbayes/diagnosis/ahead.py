"""Compile side by side what every diagnosis runs, before it is needed one after the other."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from qlvbayes.diagnosis.evidence import DRAWS, likelihoods, priors
from qlvbayes.diagnosis.samples import Samples
from qlvbayes.inference.gaussnewton import CHUNK, ROUND, noise_along
from qlvbayes.inference.linearised import (
    likelihood_terms,
    predictions_along,
    prior_terms,
    whitened,
)
from qlvbayes.inference.subset import Ensemble, Part
from qlvbayes.inference.together import together


def compile_ahead(ensemble: Ensemble, samples: Samples) -> None:
    """Run each function once; a few milliseconds where a pad of the same shape came before."""
    posterior, centre = ensemble.posterior, ensemble.centre
    plain = ensemble.usual_parts[0]
    constants = np.full(len(ensemble.names), 0.5)  # the values do not matter
    nothing = np.zeros((ROUND, *posterior.record.blocks.force.shape))
    noise, _ = noise_along(posterior.noise, constants, np.zeros((ROUND, constants.size)))

    def predict(part: Part) -> object:
        still = np.zeros((CHUNK, part.constants.size))
        return predictions_along(part.posterior, constants[part.constants], still)

    def judge(chunks: int) -> object:
        still = np.zeros((chunks * ROUND, constants.size))
        slopes = np.concatenate([nothing] * chunks)
        terms = noise_along(posterior.noise, constants, still)
        return likelihood_terms(*terms, posterior.record, nothing[0], slopes)

    jobs: list[Callable[[], object]] = [
        *(partial(predict, part) for part in reversed(ensemble.usual_parts)),
        partial(prior_terms, posterior, centre),
        partial(likelihoods, plain.posterior, np.tile(constants[plain.constants], (DRAWS, 1))),
        partial(samples.predict_with, plain, constants),
        partial(priors, posterior, np.tile(centre, (DRAWS, 1))),
        *(partial(judge, chunks) for chunks in (1, 2)),
        partial(whitened, noise, posterior.record, nothing),
    ]
    together(lambda job: job(), jobs)
