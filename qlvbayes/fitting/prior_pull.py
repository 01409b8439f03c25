"""Tell which constants a prior pulls: those whose estimate lies far out of it."""

from __future__ import annotations

from math import log

from scipy.special import ndtri

from qlvbayes.fitting.summary import FitSummary
from qlvbayes.io.checks import InputError
from qlvbayes.io.wording import as_typed, plain
from qlvbayes.model.overrides import parse_prior
from qlvbayes.priors import AbstractPrior, HalfNormal, LogNormal, LogUniform, Normal, Uniform

_FAR = 2.5  # sds of a normal prior: in 1.2 % of pads an estimate lies further out if it is right


def pulled(summary: FitSummary, priors: dict[str, str]) -> tuple[str, ...]:
    r"""Return a sentence on each constant whose posterior median lies far out of its prior.

    The median x lies z scales out, where :math:`\Phi(z)` is the prior's probability below x; of a
    half-normal prior, z = x/sd. ``priors`` are those of ``posterior.nc``, as on the command line.
    """
    texts = {
        name if name in summary.parameters else f"{name}[{k}]": one
        for name, text in priors.items()
        for k, one in enumerate(text.split(" > "), 1)  # rates fall: v[1] > v[2]
    }
    found = []
    for name, text in texts.items():
        constant = summary.parameters.get(name)
        try:
            prior = parse_prior(text)
        except InputError:  # fixed, not sampled, or a user's own
            continue
        if constant is None or constant.fixed:
            continue
        out, wider = _scales_out(prior, constant.median)
        if abs(out) > _FAR:
            found.append(
                f"{name}: the estimate lies {plain(abs(out), 2)} prior scales out, and the prior "
                f"{text} pulls it {'down' if out > 0.0 else 'up'}; a wider one: "
                f"{as_typed('--prior', f'{name}={wider}')}"
            )
    return tuple(found)


def _scales_out(prior: AbstractPrior, value: float) -> tuple[float, str]:
    """Return how many scales a value lies out of its prior, and a prior in which it lies one out.

    Bounds become wider by their distance, or tenfold where the prior is of a logarithm.
    """
    match prior:
        case HalfNormal(sd=sd):
            return value / sd, f"halfnormal({plain(value, 2)})"
        case Normal(mean=mean, sd=sd):
            return (value - mean) / sd, f"normal({mean:g},{plain(abs(value - mean), 2)})"
        case LogNormal(log_median=middle, log_sd=sd):
            off = log(value) - middle
            return off / sd, f"lognormal({middle:g},{plain(abs(off), 2)})"
        case Uniform(low=low, high=high):
            reach, below = high - low, (value - low) / (high - low)
            lower = max(low - reach, min(low, 0.0)) if below < 0.5 else low
            return ndtri(below), f"uniform({lower:g},{high + reach * (below > 0.5):g})"
        case LogUniform(low=low, high=high):
            below = log(value / low) / log(high / low)
            ends = (low / 10.0, high) if below < 0.5 else (low, 10.0 * high)
            return ndtri(below), "loguniform({:g},{:g})".format(*ends)
    return 0.0, ""
