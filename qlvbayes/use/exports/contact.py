"""Force laws of simulators' own contacts, which know the depth and the speed of the moment alone.

Depth x >= 0 in m, positive as the bodies overlap, speed v in m/s, positive as they approach, force
in N, arrays of one shape. None of them pulls.
"""

from __future__ import annotations

import numpy as np

from qlvbayes.io.arrays import Array as Floats

LEAST_IMPEDANCE = 1e-4
"""MuJoCo's own bound on the impedance (mjMINIMP)."""


def hunt_crossley(depth: Floats, speed: Floats, stiffness: float, dissipation: float) -> Floats:
    r"""Return the force of Drake's point contact, of a soft body with a hard one.

    .. math:: F = k\, x\, (1 + d\, v)_+

    stiffness k (N/m), dissipation d (s/m). Of a soft layer that a flat face presses, Drake's
    hydroelastic contact is the same with k = E_h A/H: modulus E_h (Pa), area A (m2), depth of the
    foundation H (m; of a box half its thickness). Drake, "Modeling compliant contact"; Hunt &
    Crossley 1975, doi:10.1115/1.3423596.
    """
    return stiffness * np.maximum(depth, 0.0) * np.maximum(1.0 + dissipation * speed, 0.0)


def impedance(
    depth: Floats, least: float, most: float, width: float, midpoint: float, power: float
) -> Floats:
    r"""Return MuJoCo's impedance d(x): a power from either end of a sigmoid over the width.

    .. math:: d = d_0 + (d_w - d_0)\, y(x/w), \quad y(s) = s^p/m^{p - 1}\ (s \le m), \quad
              1 - (1 - s)^p/(1 - m)^{p - 1}\ (s > m), \quad y = 1\ (s \ge 1)

    The parameters are those of ``solimp``, in its order. MuJoCo, "Modeling", solver parameters.
    """
    s = np.clip(np.abs(depth) / width, 0.0, 1.0)
    rising = s**power / midpoint ** (power - 1.0)
    falling = 1.0 - (1.0 - s) ** power / (1.0 - midpoint) ** (power - 1.0)
    return least + (most - least) * np.where(s <= midpoint, rising, falling)


def soft_constraint(
    depth: Floats,
    speed: Floats,
    stiffness: float,
    damping: float,
    solimp: tuple[float, float, float, float, float],
    *,
    mass: float = 1.0,
    acceleration: Floats | float = 0.0,
) -> Floats:
    r"""Return the normal force of MuJoCo's contact, ``solref`` as (-stiffness, -damping).

    .. math:: F = \Big(m \frac{d(x)}{1 - d(x)} \Big(\dot v + \frac{B}{d_w} v
              + S \frac{d(x)}{d_w^2} x\Big)\Big)_+

    stiffness S (1/s2), damping B (1/s); mass m (kg): one over the constraint's diagonal, which is
    the mass of a free body against a fixed one; acceleration dv/dt (m/s2), whose factor is a mass
    that the constraint adds. From a_1 + d (b v + k r) = (1 - d) a_0 and F = m (a_1 - a_0). MuJoCo,
    "Modeling", solver parameters, and "Computation", constraint model.
    """
    d, most = impedance(depth, *solimp), solimp[1]
    pull = acceleration + damping / most * speed + stiffness * d / most**2 * depth
    return np.where(depth > 0.0, np.maximum(mass * d / (1.0 - d) * pull, 0.0), 0.0)
