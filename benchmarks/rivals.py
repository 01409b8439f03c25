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


class NumpyPosterior:
    """The log posterior of one test on the same blocks, priors and noise, in plain numpy.

    Loops over the grid and over the blocks, as emcee's users write it: one walker a call.
    """

    def __init__(self, record, scales):
        motion, blocks = record.motion, record.blocks
        self.time = np.asarray(motion.time[0])
        self.depth = np.maximum(np.asarray(motion.displacement[0]), 0.0)
        real = np.asarray(blocks.real[0])
        self.nodes = np.asarray(record.nodes[0])[real]
        names = ("force", "count", "first", "last")
        self.force, self.count, self.first, self.last = (
            np.asarray(getattr(blocks, name)[0])[real] for name in names
        )
        last = int(self.nodes.max()) + 1
        self.time, self.depth = self.time[:last], self.depth[:last]
        self.scales = scales

    def predicted(self, m, b, c, v):
        """Block means."""
        q = np.zeros(len(v))
        before_t, before_d = self.time[0], 0.0
        grown_before = 1.0
        force = np.empty_like(self.time)
        for k, (t, d) in enumerate(zip(self.time, self.depth, strict=True)):
            decay = np.exp(-v * (t - before_t))
            grown = np.exp(b * d)
            x = b * (d - before_d) + v * (t - before_t)
            safe = np.where(np.abs(x) < 1e-12, 1.0, x)
            ratio = np.where(np.abs(x) < 1e-12, grown, (grown - grown_before * decay) / safe)
            q = decay * q + m * (d - before_d) * ratio
            force[k] = max(c[0] * m / b * (grown - 1.0) + c[1:] @ q, 0.0)
            before_t, before_d, grown_before = t, d, grown
        return 0.5 * (force[self.nodes[:, 0]] + force[self.nodes[:, 1]])

    def __call__(self, theta):
        """Log density over (log m, log b, logit breaks of c, log v1, log v1/v2, log noise)."""
        s = self.scales
        m, b = np.exp(theta[:2])
        p, r = 1.0 / (1.0 + np.exp(-(theta[2:4] - np.log([2.0, 1.0]))))
        c = np.array([p, (1 - p) * r, (1 - p) * (1 - r)])
        gap = np.exp(min(theta[5], 50.0))
        v = np.exp(np.array([theta[4], theta[4] - gap]))
        white, ou, tau = np.exp(theta[6:9])
        rate, width = -0.5 * np.log(s.shortest * s.longest), np.log(s.longest / s.shortest) / 4
        prior = (
            -0.5 * ((theta[0] - np.log(s.force / s.depth)) / np.log(5)) ** 2
            - 0.5 * ((theta[1] + np.log(s.depth)) / np.log(5)) ** 2
            + np.log(p) + 2 * np.log(1 - p) + np.log(r) + np.log(1 - r)
            - 0.5 * np.sum(((np.log(v) - rate) / width) ** 2) + theta[5]
            - 0.5 * ((theta[6] - np.log(s.white)) / np.log(1.2)) ** 2
            - 0.5 * (ou / (3 * np.hypot(s.white, s.ou))) ** 2 + theta[7]
            - 0.5 * ((theta[8] - np.log(s.tau)) / np.log(3)) ** 2
        )  # fmt: skip
        if not np.isfinite(prior):
            return -np.inf
        return prior + self.log_likelihood(self.force - self.predicted(m, b, c, v), white, ou, tau)

    def log_likelihood(self, residual, white, ou, tau):
        """Kalman filter over block means of white plus Ornstein-Uhlenbeck noise."""
        mean, variance, total, last = 0.0, ou**2, 0.0, self.first[0]
        for y, n, t0, t1 in zip(residual, self.count, self.first, self.last, strict=True):
            gap = np.exp(-(t0 - last) / tau)
            mean, variance = gap * mean, gap**2 * variance + ou**2 * (1 - gap**2)
            a = span = 1.0
            own = shared = 0.0
            if n > 1:
                step = (t1 - t0) / (n - 1) / tau
                loss = -np.expm1(-step)
                span, a = np.exp(-step * (n - 1)), -np.expm1(-step * n) / (n * loss)
                own = max(((2 - loss) - 2 * (1 - loss) * a) / (n * loss) - a**2, 0.0)
                shared = a * (1 - span)
            spread = a**2 * variance + ou**2 * own + white**2 / n
            both = span * a * variance + ou**2 * shared
            error = y - a * mean
            total -= 0.5 * (np.log(2 * np.pi * spread) + error**2 / spread)
            mean = span * mean + both / spread * error
            variance = span**2 * variance + ou**2 * (1 - span**2) - both**2 / spread
            last = t1
        return total
