"""The evidence once more, by nested sampling."""

from __future__ import annotations

from qlvbayes.diagnosis.result import Sampled
from qlvbayes.diagnosis.search import Search, Tell, described


def nested_audit(
    search: Search, seed: int = 0, tell: Tell = lambda text: None, best: int = 2
) -> tuple[Sampled, ...]:
    """Nested sampling of the plain model and the likeliest hypotheses, a minute or two each.

    Under the noise floor alone, without a discrepancy, against Laplace's approximation of the same.
    """
    # here, as few ask for it and blackjax is slow to import
    from qlvbayes.inference.nested import nested_evidence

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
