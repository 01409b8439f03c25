"""Compute each part as a user would write it with numpy, scipy and emcee, for comparison."""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.signal import fftconvolve, lfilter


def by_lfilter(source, decay):
    """Sums (N,) of all sources so far, each faded by decay a step, by recursion."""
    return lfilter([1.0], [1.0, -decay], source)


def by_fft(source, decay):
    """The same as a convolution by fast Fourier transforms."""
    return fftconvolve(source, decay ** np.arange(source.size))[: source.size]


def by_convolution(source, decay):
    """The same as a plain convolution: N^2 products."""
    return np.convolve(source, decay ** np.arange(source.size))[: source.size]


def qlv_force(constants, time, depth, faded=by_lfilter):
    """QLV force of evenly sampled records (T, N), by one convolution a mode and test."""
    m, b, c, v = constants
    step = time[0, 1] - time[0, 0]
    out = np.empty_like(depth)
    for k, d in enumerate(depth):
        grown = np.exp(b * d)
        force = c[0] * m / b * (grown - 1.0)
        travel = np.diff(d)
        for share, rate in zip(c[1:], v, strict=True):
            x = b * travel + rate * step
            ratio = np.where(x != 0.0, np.expm1(x) / np.where(x == 0.0, 1.0, x), 1.0)
            source = m * travel * grown[:-1] * np.exp(-rate * step) * ratio
            force[1:] += share * faded(source, np.exp(-rate * step))
        out[k] = force
    return out


def ivp_displacement(constants, time, force):
    """Displacement (N,) under a sampled force (N,), straight between samples, by scipy's LSODA.

    d' = (F' + sum c_i v_i q_i)/K, q_i' = K d' - v_i q_i, from rest under the first force.
    """
    m, b, c, v = constants
    slopes = np.diff(force) / np.diff(time)
    start = np.log1p(b * force[0] / m) / b

    def rates(t, state):
        index = min(max(np.searchsorted(time, t, side="right") - 1, 0), slopes.size - 1)
        stiffness = m * np.exp(b * state[0])
        flow = slopes[index] + np.sum(c[1:] * v * state[1:])
        return np.array([flow / stiffness, *(flow - v * state[1:])])

    first = np.array([start, *np.full(v.size, force[0])])
    found = solve_ivp(
        rates, time[[0, -1]], first, "LSODA", t_eval=time, rtol=1e-8, atol=1e-10,
        max_step=100.0 * (time[1] - time[0]),
    )  # fmt: skip
    return found.y[0]
