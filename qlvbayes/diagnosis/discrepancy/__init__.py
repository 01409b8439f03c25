r"""What no model on the list explains, as a Gaussian process: an alarm, not an explanation.

The residuals of the last model are taken as a smooth unknown function plus the noise floor that was
measured without the model (Kennedy and O'Hagan 2001, doi:10.1111/1467-9868.00294):

.. math::
    r = \delta(x) + \delta_{test}(x) + \epsilon, \quad
    k(x, x') = g g' [phase = phase'] [a^2 k_t k_d k_v + (p^2 k_t k_d) [test = test']]

with Matern-3/2 correlations k_t, k_d and k_v over the logarithm of the time since the phase began,
the depth and the logarithm of the loading rate; g is 1 where the force is largest and a half where
there is none. One function is shared by all tests, another is each test's own. It keeps the
intervals of predictions honest. It says nothing about what is missing, and its mean must not be
read as a correction of the material's constants.
"""

from qlvbayes.diagnosis.discrepancy.fitted import Discrepancy, fit_discrepancy

__all__ = ["Discrepancy", "fit_discrepancy"]
