r"""An effect too small to matter does not count as missing.

What Bayes factors weigh against "nothing is missing" is an effect whose amplitude a has the prior

.. math:: p(a) \propto \pi(a) \left(1 - e^{-a^2 / 2 t^2}\right),

pi its own normal or half-normal prior of sd s and t = s/5: as that sd stands for 5 % of the peak
force, a contribution of 1 %, the diagnosis's ``tolerance``. Without the bracket the commonest
effect would be none at all, and tests that rule out all but nothing would hardly speak for
"nothing" (Johnson & Rossell 2010, doi:10.1111/j.1467-9868.2009.00730.x). With E the mean over
posterior or prior of the bracket, the Bayes factor changes by

.. math:: \frac{E[1 - e^{-a^2 / 2 t^2} \mid data]}{E[1 - e^{-a^2 / 2 t^2}]}

(Rossell & Telesca 2017, doi:10.1080/01621459.2015.1130634). The posterior of a is taken as normal,
cut at zero where the prior is.
"""

from __future__ import annotations

import math

from scipy.stats import norm

from qlvbayes.laws.scales import SHARE, TOLERANCE
from qlvbayes.priors import HalfNormal, Normal

_EXACT = 1e-9  # of t: sd of an amplitude that is known exactly
_FAR = 1e3  # sds below zero, from which it makes no difference
_ROUNDING = 1e-12


def log_noticeable(
    prior: HalfNormal | Normal, mean: float, sd: float, tolerance: float = TOLERANCE
) -> float:
    """Log of the ratio above for a posterior N(mean, sd^2) of an amplitude.

    tolerance: share of the peak force from which a contribution matters; 0: every one does.
    """
    size = float(prior.sd)
    t = tolerance / SHARE * size
    if t == 0.0:
        return 0.0
    found = _kept(mean, sd, t, isinstance(prior, HalfNormal))
    before = 1.0 - t / math.hypot(t, size)
    return math.log(max(found, _ROUNDING)) - math.log(before)


def log_density(prior: HalfNormal | Normal, amplitude: float) -> float:
    """Log density of the prior with the bracket."""
    return float(prior.log_density(amplitude)) + log_noticeable(prior, amplitude, 0.0)


def _kept(mean: float, sd: float, t: float, positive: bool) -> float:
    """Mean of 1 - exp(-a^2/2t^2), a normal, above zero only where ``positive``."""
    mean = max(mean, -_FAR * sd) if positive else mean
    if sd < _EXACT * t:
        return -math.expm1(-0.5 * (mean / t) ** 2)
    wide = math.hypot(sd, t)
    log_lost = math.log(t / wide) - 0.5 * (mean / wide) ** 2
    if positive:
        log_lost += float(norm.logcdf(mean * t / (sd * wide)) - norm.logcdf(mean / sd))
    return -math.expm1(log_lost)
