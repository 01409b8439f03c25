"""The elastic laws in plain arithmetic, from which the C and the MATLAB code are translated.

A function here is assignments and one ``return``, of numbers, ``k.name`` (a law's constant),
``exp``, ``expm1``, ``pow``, comparisons, ``a if condition else b`` and other functions of this
file: ``translation`` takes no more. Each law has F_e, K, the step of a relaxing mode (as
``AbstractElastic.relaxed_step``) and the slope of that step along its end, which Newton's method
needs. ``decay`` is v h of the step, ``left`` e^{-decay}.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import exp, expm1, pow
from typing import Any

Function = Callable[..., float]


def size(x: float) -> float:
    """Return the magnitude of x."""
    return -x if x < 0.0 else x


def smaller(x: float, y: float) -> float:
    """Return the smaller of both."""
    return x if x < y else y


def larger(x: float, y: float) -> float:
    """Return the larger of both."""
    return x if x > y else y


def exp_series(x: float) -> float:
    """(e^x - 1)/x by its series, for a magnitude below 0.04."""
    tail = 1.0 / 24.0 + x * (1.0 / 120.0 + x * (1.0 / 720.0 + x * (1.0 / 5040.0 + x / 40320.0)))
    return 1.0 + x * (1.0 / 2.0 + x * (1.0 / 6.0 + x * tail))


def exp_slope(x: float) -> float:
    """(e^x - 1)/x, 1 at 0."""
    return exp_series(x) if size(x) < 0.04 else expm1(x) / x


def growth(x: float, rate: float) -> float:
    """(e^(rate x) - 1)/rate, x at rate 0."""
    return x * exp_series(rate * x) if size(rate * x) < 0.04 else expm1(rate * x) / rate


def ratio(top: float, bottom: float, gap: float) -> float:
    """(top - bottom)/gap where top = bottom e^gap."""
    return bottom * exp_series(gap) if size(gap) < 0.04 else (top - bottom) / gap


def ratio_slope(top: float, bottom: float, gap: float) -> float:
    """Of `ratio` along the gap, bottom held: a Newton step asks for three digits at the seam."""
    series = 1.0 / 2.0 + gap * (1.0 / 3.0 + gap * (1.0 / 8.0 + gap / 30.0))
    return bottom * series if size(gap) < 0.04 else (top - (top - bottom) / gap) / gap


def first_series(x: float) -> float:
    """`first_moment` by its series, for a decay below 0.3: the next term is below 1e-17."""
    tail = 1.0 / 3628800.0 - x * (
        1.0 / 39916800.0 - x * (1.0 / 479001600.0 - x * (1.0 / 6227020800.0))
    )
    high = 1.0 / 720.0 - x * (1.0 / 5040.0 - x * (1.0 / 40320.0 - x * (1.0 / 362880.0 - x * tail)))
    return 1.0 / 2.0 - x * (1.0 / 6.0 - x * (1.0 / 24.0 - x * (1.0 / 120.0 - x * high)))


def first_moment(decay: float) -> float:
    """Integral of s e^{-decay(1-s)} over s in (0, 1)."""
    return first_series(decay) if decay < 0.3 else (1.0 - exp_slope(-decay)) / decay


def second_series(x: float) -> float:
    """`second_moment` by its series, for a decay below 0.3: the next term is below 1e-17."""
    tail = 1.0 / 19958400.0 - x * (
        1.0 / 239500800.0 - x * (1.0 / 3113510400.0 - x * (1.0 / 43589145600.0))
    )
    high = 1.0 / 2520.0 - x * (
        1.0 / 20160.0 - x * (1.0 / 181440.0 - x * (1.0 / 1814400.0 - x * tail))
    )
    return 1.0 / 3.0 - x * (1.0 / 12.0 - x * (1.0 / 60.0 - x * (1.0 / 360.0 - x * high)))


def second_moment(decay: float) -> float:
    """Integral of s^2 e^{-decay(1-s)} over s in (0, 1)."""
    return second_series(decay) if decay < 0.3 else (1.0 - 2.0 * first_moment(decay)) / decay


def exponential_force(k: Any, depth: float) -> float:
    """F_e = (m/b)(e^{b depth} - 1)."""
    return k.m * growth(depth, k.b)


def exponential_stiffness(k: Any, depth: float) -> float:
    """K = m e^{b depth}."""
    return k.m * exp(k.b * depth)


def exponential_step(
    k: Any, start: float, stop: float, at_start: float, at_stop: float, decay: float, left: float
) -> float:
    """Exact: m dd (e^{b d1} - e^{b d0 - v h})/(b dd + v h)."""
    bottom = (k.m + k.b * at_start) * left
    return (stop - start) * ratio(k.m + k.b * at_stop, bottom, k.b * (stop - start) + decay)


def exponential_slope(
    k: Any, start: float, stop: float, at_start: float, at_stop: float, decay: float, left: float
) -> float:
    """Return the step's slope along its end."""
    bottom = (k.m + k.b * at_start) * left
    top = k.m + k.b * at_stop
    gap = k.b * (stop - start) + decay
    return ratio(top, bottom, gap) + (stop - start) * k.b * ratio_slope(top, bottom, gap)


def linear_force(k: Any, depth: float) -> float:
    """F_e = m depth."""
    return k.m * depth


def linear_stiffness(k: Any, depth: float) -> float:
    """K = m."""
    return k.m


def linear_step(
    k: Any, start: float, stop: float, at_start: float, at_stop: float, decay: float, left: float
) -> float:
    """Exact: m dd (1 - e^{-v h})/(v h)."""
    return k.m * (stop - start) * exp_slope(-decay)


def linear_slope(
    k: Any, start: float, stop: float, at_start: float, at_stop: float, decay: float, left: float
) -> float:
    """Return the step's slope along its end."""
    return k.m * exp_slope(-decay)


def quadratic_force(k: Any, depth: float) -> float:
    """F_e = m depth + k2 depth^2."""
    return depth * (k.m + k.k2 * depth)


def quadratic_stiffness(k: Any, depth: float) -> float:
    """K = m + 2 k2 depth."""
    return k.m + 2.0 * k.k2 * depth


def quadratic_step(
    k: Any, start: float, stop: float, at_start: float, at_stop: float, decay: float, left: float
) -> float:
    """Exact: dd (K(d0) M_0 + 2 k2 dd M_1)."""
    travel = stop - start
    bend = 2.0 * k.k2 * travel * first_moment(decay)
    return travel * (quadratic_stiffness(k, start) * exp_slope(-decay) + bend)


def quadratic_slope(
    k: Any, start: float, stop: float, at_start: float, at_stop: float, decay: float, left: float
) -> float:
    """Return the step's slope along its end."""
    bend = 4.0 * k.k2 * (stop - start) * first_moment(decay)
    return quadratic_stiffness(k, start) * exp_slope(-decay) + bend


def cubic_force(k: Any, depth: float) -> float:
    """F_e = m depth + k2 depth^2 + k3 depth^3."""
    return depth * (k.m + depth * (k.k2 + k.k3 * depth))


def cubic_stiffness(k: Any, depth: float) -> float:
    """K = m + 2 k2 depth + 3 k3 depth^2."""
    return k.m + depth * (2.0 * k.k2 + 3.0 * k.k3 * depth)


def cubic_step(
    k: Any, start: float, stop: float, at_start: float, at_stop: float, decay: float, left: float
) -> float:
    """Exact: dd (K(d0) M_0 + K'(d0) dd M_1 + 3 k3 dd^2 M_2)."""
    travel = stop - start
    bend = travel * (2.0 * k.k2 + 6.0 * k.k3 * start) * first_moment(decay)
    curl = 3.0 * k.k3 * travel * travel * second_moment(decay)
    return travel * (cubic_stiffness(k, start) * exp_slope(-decay) + bend + curl)


def cubic_slope(
    k: Any, start: float, stop: float, at_start: float, at_stop: float, decay: float, left: float
) -> float:
    """Return the step's slope along its end."""
    travel = stop - start
    bend = 2.0 * travel * (2.0 * k.k2 + 6.0 * k.k3 * start) * first_moment(decay)
    curl = 9.0 * k.k3 * travel * travel * second_moment(decay)
    return cubic_stiffness(k, start) * exp_slope(-decay) + bend + curl


def toe_force(k: Any, depth: float) -> float:
    """F_e, linear to the depth ``toe``, exponential beyond."""
    return k.m * (smaller(depth, k.toe) + growth(larger(depth - k.toe, 0.0), k.b))


def toe_stiffness(k: Any, depth: float) -> float:
    """K = m e^{b max(depth - toe, 0)}."""
    return k.m * exp(k.b * larger(depth - k.toe, 0.0))


def toe_share(k: Any, start: float, stop: float) -> float:
    """Share of the step's time that is spent in the toe."""
    still = 1.0 if start <= k.toe else 0.0
    moved = smaller(stop, k.toe) - smaller(start, k.toe)
    return still if stop == start else moved / (stop - start)


def toe_beyond(k: Any, start: float, stop: float, decay: float) -> float:
    """Return the step's part beyond the toe, ``decay`` of its own time."""
    first = larger(start - k.toe, 0.0)
    last = larger(stop - k.toe, 0.0)
    bottom = k.m * exp(k.b * first - decay)
    return (last - first) * ratio(k.m * exp(k.b * last), bottom, k.b * (last - first) + decay)


def toe_step(
    k: Any, start: float, stop: float, at_start: float, at_stop: float, decay: float, left: float
) -> float:
    """Exact: what is passed first decays through the rest of the step."""
    share = toe_share(k, start, stop)
    in_toe = share * decay
    after = (1.0 - share) * decay
    later_toe = 0.0 if stop < start else after
    later_beyond = in_toe if stop < start else 0.0
    moved = smaller(stop, k.toe) - smaller(start, k.toe)
    toe = k.m * moved * exp_slope(-in_toe) * exp(-later_toe)
    return toe + toe_beyond(k, start, stop, after) * exp(-later_beyond)


def toe_slope(
    k: Any, start: float, stop: float, at_start: float, at_stop: float, decay: float, left: float
) -> float:
    """Return the slope along the step's end: K(d1) - v h int s K e^{-v h (1-s)}."""
    share = toe_share(k, start, stop)
    in_toe = share * decay
    after = (1.0 - share) * decay
    first = larger(start - k.toe, 0.0)
    last = larger(stop - k.toe, 0.0)
    top = k.m * exp(k.b * last)
    bottom = k.m * exp(k.b * first - after)
    gap = k.b * (last - first) + after
    bent = (1.0 - share) * ratio_slope(top, bottom, gap)
    flat = k.m * share * first_moment(in_toe)
    rising = exp(-after) * share * flat + (1.0 - share) * (share * ratio(top, bottom, gap) + bent)
    toe = share * (k.m * (1.0 - share) * exp_slope(-in_toe) + flat)
    falling = toe + exp(-in_toe) * (1.0 - share) * bent
    return top - decay * (falling if stop < start else rising)


def hertz_force(k: Any, depth: float) -> float:
    """F_e = m depth^n, odd in depth."""
    return 0.0 if depth == 0.0 else (-1.0 if depth < 0.0 else 1.0) * k.m * pow(size(depth), k.n)


def hertz_stiffness(k: Any, depth: float) -> float:
    """K = m n depth^(n - 1)."""
    return 0.0 if depth == 0.0 else k.m * k.n * pow(size(depth), k.n - 1.0)


def hertz_step(
    k: Any, start: float, stop: float, at_start: float, at_stop: float, decay: float, left: float
) -> float:
    """Return the force quadratic over the step, as in the Python law; no closed form is known."""
    middle = hertz_force(k, 0.5 * (start + stop))
    slope = 4.0 * middle - 3.0 * at_start - at_stop
    bend = 4.0 * (at_start + at_stop - 2.0 * middle)
    return slope * exp_slope(-decay) + bend * first_moment(decay)


def hertz_slope(
    k: Any, start: float, stop: float, at_start: float, at_stop: float, decay: float, left: float
) -> float:
    """Return the step's slope along its end."""
    middle = hertz_stiffness(k, 0.5 * (start + stop))
    last = hertz_stiffness(k, stop)
    bend = 4.0 * (last - middle) * first_moment(decay)
    return (2.0 * middle - last) * exp_slope(-decay) + bend


@dataclass(frozen=True)
class Formulas:
    """F_e, K, the step of a relaxing mode, and its slope."""

    force: Function
    stiffness: Function
    step: Function
    slope: Function


FORMULAS: dict[str, Formulas] = {
    "exponential": Formulas(
        exponential_force, exponential_stiffness, exponential_step, exponential_slope
    ),
    "linear": Formulas(linear_force, linear_stiffness, linear_step, linear_slope),
    "polynomial:2": Formulas(quadratic_force, quadratic_stiffness, quadratic_step, quadratic_slope),
    "polynomial:3": Formulas(cubic_force, cubic_stiffness, cubic_step, cubic_slope),
    "toe": Formulas(toe_force, toe_stiffness, toe_step, toe_slope),
    "hertz": Formulas(hertz_force, hertz_stiffness, hertz_step, hertz_slope),
}
"""By the laws' names, as after ``--elastic``."""
