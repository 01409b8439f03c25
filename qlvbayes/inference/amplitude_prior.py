r"""Give the prior of an amplitude, which excludes effects too small to matter.

A Bayes factor compares "nothing is missing" with an effect whose amplitude a has the prior

.. math:: p(a) \propto \pi(a) \left(1 - e^{-a^2 / 2 t^2}\right).

Here pi is the effect's normal or half-normal prior of sd s, and t = s/5. That sd stands for 5 % of
the peak force, so t stands for a contribution of 1 %, the diagnosis's ``tolerance``. Without the
bracket the most probable effect would be none at all, and tests that rule out all but a negligible
effect would hardly support "nothing" (Johnson & Rossell 2010,
doi:10.1111/j.1467-9868.2009.00730.x). With E the mean over posterior or prior, the bracket changes
the Bayes factor by

.. math:: \frac{E[1 - e^{-a^2 / 2 t^2} \mid data]}{E[1 - e^{-a^2 / 2 t^2}]}

(Rossell & Telesca 2017, doi:10.1080/01621459.2015.1130634). The posterior of a is taken as normal,
truncated at zero where the prior is.
"""

from __future__ import annotations

import math

from scipy.stats import norm

from qlvbayes.laws.scales import SHARE, TOLERANCE
from qlvbayes.priors import HalfNormal, Normal

_EXACT = 1e-9  # of t: below this sd an amplitude counts as known exactly
_FAR = 1e3  # sds: a mean farther below zero makes no difference
_ROUNDING = 1e-12


def log_noticeable(
    prior: HalfNormal | Normal, mean: float, sd: float, tolerance: float = TOLERANCE
) -> float:
    """Return the log of the ratio above for a posterior N(mean, sd^2) of an amplitude."""
    size = float(prior.sd)
    t = tolerance / SHARE * size
    if t == 0.0:
        return 0.0
    posterior_mean = _mean_bracket(mean, sd, t, isinstance(prior, HalfNormal))
    prior_mean = 1.0 - t / math.hypot(t, size)
    return math.log(max(posterior_mean, _ROUNDING)) - math.log(prior_mean)


def _mean_bracket(mean: float, sd: float, t: float, positive: bool) -> float:
    """Return the mean of 1 - exp(-a^2/2t^2) for a normal, truncated at zero where ``positive``."""
    mean = max(mean, -_FAR * sd) if positive else mean
    if sd < _EXACT * t:
        return -math.expm1(-0.5 * (mean / t) ** 2)
    width = math.hypot(sd, t)
    log_lost = math.log(t / width) - 0.5 * (mean / width) ** 2
    if positive:
        log_lost += float(norm.logcdf(mean * t / (sd * width)) - norm.logcdf(mean / sd))
    return -math.expm1(log_lost)
