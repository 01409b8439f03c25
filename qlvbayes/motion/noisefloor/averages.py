r"""Means over n evenly spaced readings of a stationary process of correlation Re f e^{-z|t|}.

An Ornstein-Uhlenbeck process has f = 1, z = 1/tau; white noise through a second-order low-pass f =
1 - i, z = (1 - i)/tau. With rho = e^{-z h} for readings h apart, the mean's correlation with a
reading d before (or behind) is e^{-zd} a, its variance v:

.. math:: a = \frac{1 - \rho^n}{n (1 - \rho)}, \quad
          v = \frac{1 + \rho - 2 \rho a}{n (1 - \rho)}

Few readings far apart average as independent ones: no integral over the stretch would say so.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from qlvbayes.io.arrays import Array

_NONE = 1e-9  # of tau: readings nearer are one, to first order in their distance


def rate(tau: float, smooth: bool) -> complex:
    """Return the rate z (1/s) of an Ornstein-Uhlenbeck process, or of a smooth one."""
    return (1.0 - 1.0j if smooth else 1.0) / tau


def regression(length: Array, count: Array, z: complex) -> NDArray[np.complex128]:
    """Return the coefficient a (n,) of means of ``count`` readings over ``length``."""
    several, x = _steps(length, count, z)
    return np.where(several, np.expm1(-x * count) / (count * np.expm1(-x)), 1.0)


def variance(length: Array, count: Array, z: complex) -> NDArray[np.complex128]:
    """Return the variance v (n,) of the same means; times f, its real part is theirs."""
    several, x = _steps(length, count, z)
    loss = -np.expm1(-x)
    a = np.expm1(-x * count) / (count * -loss)
    return np.where(several, (2.0 - loss - 2.0 * (1.0 - loss) * a) / (count * loss), 1.0)


def _steps(length: Array, count: Array, z: complex) -> tuple[NDArray[np.bool_], Array]:
    """Return which means are over several instants, and z times their distance (elsewhere 1)."""
    x = z * length / np.maximum(count - 1.0, 1.0)
    several = (count > 1.0) & (np.abs(x) > _NONE)
    return several, np.where(several, x, 1.0)
