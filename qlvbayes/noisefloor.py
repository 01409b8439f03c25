"""The noise of the load cell, measured at rest and without any model of the material."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve_banded, cholesky, cholesky_banded, qr, solve_triangular
from scipy.optimize import Bounds, minimize, minimize_scalar

from qlvbayes.kinematics.phases import Phase
from qlvbayes.kinematics.segments import sensor_noise

Array = NDArray[np.float64]

_MOST_HOLDS = 12
_BURST, _SPREAD = 150, 150  # samples in a row; samples over the whole hold
_FEWEST_SAMPLES = 24
_CONTACT = 0.02  # of the largest force: below, contact may be lost
_TREND_RATIOS = (2.0, 1.4)  # between neighbouring relaxation times of the trend
_QUIET = 1e-3  # of the force range: below, the coarser trend would leave more than the noise
_TAUS = 9
_USUAL_TAU = 0.03  # of a rest: a longer memory looks like the trend, so that short rests
_TAU_SD = 1.0  # need a weak prior, log-normal with this sd
_DECISIVE = 2.0  # log-likelihood by which the second process must win
_WHITE_RANGE = 2.0  # log of the total, either way, in which the white noise is sought
_FLOOR = 1e-9  # of the force range, for data without noise


@dataclass(frozen=True)
class NoiseFloor:
    """White noise of sd ``white`` plus an Ornstein-Uhlenbeck process of sd ``ou``.

    cov(t, t') = white^2 [t = t'] + ou^2 exp(-|t - t'| / tau); sds in units of force, ``tau`` in s.
    ``ou`` is 0 where no correlation is seen; ``tau`` is then a neutral tenth of a hold. ``rests``:
    the readings behind it, None where there were none.
    """

    white: float
    ou: float
    tau: float
    rests: Rests | None = field(default=None, repr=False, compare=False)

    @property
    def total(self) -> float:
        """Return the sd of a single reading."""
        return float(np.hypot(self.white, self.ou))

    def surprise(self, white: float, ou: float, tau: float) -> float:
        """Log-likelihood of the rests that other noise loses against the best; 0 without rests."""
        if self.rests is None:
            return 0.0
        return self.rests.best - self.rests.log_likelihood(white, ou, tau)

    def surprise_of_correlated(self, ou: float, tau: float) -> float:
        """The same of other correlated noise, the white noise being what then suits the rests."""
        return self.surprise(self.white_beside(ou, tau), ou, tau)

    def white_beside(self, ou: float, tau: float) -> float:
        """Sd (N) of the white noise that suits the rests best beside other correlated noise."""

        def lost(log_white: float) -> float:
            return self.surprise(float(np.exp(log_white)), ou, tau)

        around = np.log(self.total) + np.array([-_WHITE_RANGE, _WHITE_RANGE])
        return float(np.exp(minimize_scalar(lost, bounds=around, options={"xatol": 0.01}).x))


class Record(Protocol):
    """The part of a test that is read here."""

    @property
    def time(self) -> Array:
        """Time in s."""
        ...

    @property
    def force(self) -> Array:
        """Force in N (or stress in kPa)."""
        ...

    @property
    def force_sd(self) -> Array | None:
        """Sd of each reading, where known."""
        ...


@dataclass(frozen=True)
class _Rest:
    """Some readings of one hold, each divided by its relative sd."""

    time: Array
    force: Array
    scale: Array


def measure(tests: Sequence[Record], phases: Sequence[Sequence[Phase]]) -> NoiseFloor:
    """Return the noise seen in the holds and recoveries of the tests, pooled.

    In each rest the force is a smooth trend plus noise. The trend is any combination of 1, t and
    exp(-t/T_j) with T_j a factor 2 apart (1.4 in very quiet data), from a few thousandths of the
    length of the rest to all of it. The noise parameters maximise the restricted likelihood, in
    which the trend costs its degrees of freedom. Up to 12 rests enter, with up to 300 readings
    each: a run of consecutive ones and others spread over the rest. The correlated part is
    reported only if it raises the log-likelihood by more than 2. With a measured sd for each
    reading (``force_sd``) the noise is taken as proportional to it, and the sds returned hold at
    its root mean square.

    Without any usable rest the white noise comes from high-order differences of the records.

    Parameters
    ----------
    tests, phases
        One entry a test; a test has ``time``, ``force`` and ``force_sd`` (or None), (n,) each.
    """
    rests = _rests(tests, phases)
    floor = _FLOOR * max((float(np.ptp(t.force)) for t in tests if t.force.size), default=0.0)
    floor = max(floor, float(np.finfo(np.float64).tiny) ** 0.5)
    if not rests:
        return _without_rests(tests, floor)
    neutral = 0.1 * float(np.median([np.ptp(r.time) for r in rests]))
    white, ou, tau, found = _pooled(rests, neutral)
    return NoiseFloor(max(white, floor), ou if ou > floor else 0.0, tau, found)


def _without_rests(tests: Sequence[Record], floor: float) -> NoiseFloor:
    found = [sensor_noise(t.time, t.force) for t in tests]
    length = max((float(np.ptp(t.time)) for t in tests if t.time.size), default=0.0)
    white = float(np.sqrt(np.mean(np.square(found)))) if found else 0.0
    return NoiseFloor(max(white, floor), 0.0, 0.1 * length if length > 0.0 else 1.0)


def _rests(tests: Sequence[Record], phases: Sequence[Sequence[Phase]]) -> list[_Rest]:
    """Return the best-sampled rests, one of each test before a second of any."""
    ranked: list[tuple[int, int, _Rest]] = []
    for test, cut in zip(tests, phases, strict=True):
        of_test = []
        for phase in cut:
            if phase.kind not in ("hold", "recovery"):
                continue
            inside = np.flatnonzero((test.time > phase.start) & (test.time <= phase.stop))
            inside = inside[_regained(test.force, inside) :]
            # The kinks may be misplaced by a few samples.
            margin = min(5, inside.size // 8)
            inside = inside[margin : inside.size - margin]
            if inside.size >= _FEWEST_SAMPLES and not _stuck(test.force[inside]):
                of_test.append((inside.size, _chosen(test, inside)))
        of_test.sort(key=lambda item: -item[0])
        ranked += [(turn, -size, rest) for turn, (size, rest) in enumerate(of_test)]
    ranked.sort(key=lambda item: item[:2])
    return [rest for _, _, rest in ranked[:_MOST_HOLDS]]


def _regained(force: Array, inside: NDArray[np.intp]) -> int:
    """First reading of a rest after which a pad that had lost contact is pressed again; 0 if none.

    Until then it reads zero; a trend with a kink would be taken for noise.
    """
    free = np.flatnonzero(force[inside] < _CONTACT * np.abs(force).max(initial=0.0))
    return 0 if free.size == 0 or free[-1] == inside.size - 1 else int(free[-1]) + 1


def _stuck(force: Array) -> bool:
    """Tell a reading that mostly repeats itself: out of contact or clipped, it shows no noise."""
    return bool(np.mean(np.diff(force) == 0.0) > 0.5)


def _chosen(test: Record, inside: NDArray[np.intp]) -> _Rest:
    """Take a run of readings where they are densest, and others spread over the rest."""
    time = test.time[inside]
    n = inside.size
    if n > _BURST + _SPREAD:
        late = np.linspace(n // 5, n - _BURST, 200).astype(int)
        start = int(late[np.argmin(time[late + _BURST - 1] - time[late])])
        burst = np.arange(start, start + _BURST)
        after = time[0] + np.geomspace(
            max(time[1] - time[0], 1e-3 * np.ptp(time)), np.ptp(time), 20
        )
        lags = time[start] + np.geomspace(time[start + _BURST - 1] - time[start], np.ptp(time), 20)
        even = np.linspace(time[0], time[-1], _SPREAD - 40)
        others = np.searchsorted(time, np.concatenate([after, lags[lags < time[-1]], even]))
        pick = np.unique(np.concatenate([burst, np.clip(others, 0, n - 1)]))
        inside = inside[pick]
    scale = np.ones(inside.size)
    if test.force_sd is not None:
        scale = test.force_sd[inside] / np.sqrt(np.mean(np.square(test.force_sd)))
        scale = np.maximum(scale, 1e-3)
    return _Rest(test.time[inside], test.force[inside], scale)


def _detrended(rest: _Rest, ratio: float) -> tuple[Array, Array]:
    """Orthonormal trend basis (n, p) and what it leaves of the readings (n,)."""
    t = rest.time - rest.time[0]
    length = float(t[-1])
    shortest = max(2.0 * float(t[1]), 2e-4 * length)
    times = length / ratio ** np.arange(1.0 + np.log(length / shortest) // np.log(ratio))
    times = times[: max(1, t.size // 6)]
    basis = np.column_stack([np.ones_like(t), t / length, np.exp(-t[:, None] / times)])
    q, r, _ = qr(basis / rest.scale[:, None], mode="economic", pivoting=True)
    size = np.abs(np.diag(r))
    q = q[:, size > 1e-10 * size[0]]
    y = rest.force / rest.scale
    y = y - q @ (q.T @ y)
    return np.asarray(q, dtype=np.float64), np.asarray(y - q @ (q.T @ y), dtype=np.float64)


@dataclass(frozen=True)
class _Pool:
    """All rests one after another: gaps in time (inf between rests), trends, what they leave."""

    gaps: Array
    trends: list[Array]
    columns: Array
    y: Array
    freedom: int

    @staticmethod
    def of(rests: list[_Rest], ratio: float) -> _Pool:
        parts = [_detrended(r, ratio) for r in rests]
        trends = [q for q, _ in parts]
        width = max(q.shape[1] for q in trends)
        columns = np.concatenate([np.pad(q, ((0, 0), (0, width - q.shape[1]))) for q in trends])
        gaps = np.concatenate([np.append(np.diff(r.time), np.inf) for r in rests])[:-1]
        y = np.concatenate([part for _, part in parts])
        return _Pool(gaps, trends, columns, y, y.size - sum(q.shape[1] for q in trends))

    def likelihood(self, log_ratio: float, log_tau: float) -> tuple[float, float]:
        """Return the restricted log-likelihood (up to a constant) and the white variance.

        With R the correlation matrix and P its tridiagonal inverse, (1 + ratio R)^-1 =
        P (P + ratio)^-1: everything costs O(n).
        """
        ratio = np.exp(log_ratio)
        a = np.exp(-self.gaps / np.exp(log_tau))
        left = -np.expm1(-2.0 * self.gaps / np.exp(log_tau))
        diagonal = np.ones(self.y.size)
        diagonal[1:] += a**2 / left
        diagonal[:-1] += a**2 / left
        beside = -a / left
        band = np.zeros((2, self.y.size))
        band[0, 1:], band[1] = beside, diagonal + ratio
        factor = cholesky_banded(band, check_finite=False)
        z = np.column_stack([self.y, self.columns])
        inner = cho_solve_banded((factor, False), z, check_finite=False)
        solved = diagonal[:, None] * inner
        solved[1:] += beside[:, None] * inner[:-1]
        solved[:-1] += beside[:, None] * inner[1:]
        log_det = 2.0 * float(np.log(factor[1]).sum()) + float(np.log(left).sum())
        power = float(self.y @ solved[:, 0])
        at = 0
        for q in self.trends:
            rows, at = slice(at, at + q.shape[0]), at + q.shape[0]
            gram = cholesky(q.T @ solved[rows, 1 : q.shape[1] + 1], lower=True, check_finite=False)
            moment = solve_triangular(gram, q.T @ solved[rows, 0], lower=True, check_finite=False)
            power -= float(moment @ moment)
            log_det += 2.0 * float(np.log(np.diag(gram)).sum())
        power = max(power, np.finfo(np.float64).tiny)
        return -0.5 * (self.freedom * np.log(power / self.freedom) + log_det), power / self.freedom


@dataclass(frozen=True, eq=False)
class Rests:
    """The pooled rests and the highest restricted log-likelihood that any noise gives them."""

    pool: _Pool
    best: float

    def log_likelihood(self, white: float, ou: float, tau: float) -> float:
        """Restricted log-likelihood (up to a constant) of some noise."""
        log_ratio = 2.0 * np.log(max(ou / white, 1e-3))
        profile, variance = self.pool.likelihood(float(log_ratio), float(np.log(tau)))
        size = variance / white**2
        return profile - 0.5 * self.pool.freedom * (size - 1.0 - float(np.log(size)))


def _pooled(rests: list[_Rest], neutral: float) -> tuple[float, float, float, Rests | None]:
    """White sd, correlated sd and its time, by restricted maximum likelihood."""
    span = max(float(np.ptp(r.force)) for r in rests)
    for ratio in _TREND_RATIOS:
        pool = _Pool.of(rests, ratio)
        power = float(pool.y @ pool.y)
        if power > pool.freedom * (_QUIET * span) ** 2:
            break
    if power == 0.0:
        return 0.0, 0.0, neutral, None
    gaps = pool.gaps[np.isfinite(pool.gaps)]
    shortest = 3.0 * float(np.quantile(gaps, 0.1))
    longest = 0.3 * float(np.median([np.ptp(r.time) for r in rests]))
    log_taus = np.log(np.geomspace(shortest, max(longest, 2.0 * shortest), _TAUS))
    log_ratios = np.arange(-4.0, 9.0, 2.0)
    usual = float(np.log(_USUAL_TAU * np.median([np.ptp(r.time) for r in rests])))

    def loss(at: Sequence[float]) -> float:
        found = pool.likelihood(float(at[0]), float(at[1]))[0]
        return -found + 0.5 * ((float(at[1]) - usual) / _TAU_SD) ** 2

    start = min(((r, t) for t in log_taus for r in log_ratios), key=loss)

    limits = Bounds(np.array([-8.0, log_taus[0]]), np.array([12.0, log_taus[-1]]))
    best = minimize(loss, np.array(start), method="L-BFGS-B", bounds=limits)
    gain, variance = pool.likelihood(*best.x)
    found = Rests(pool, gain)
    if gain + 0.5 * pool.freedom * np.log(power / pool.freedom) < _DECISIVE:
        return float(np.sqrt(power / pool.freedom)), 0.0, neutral, found
    white = float(np.sqrt(variance))
    return white, white * float(np.exp(0.5 * best.x[0])), float(np.exp(best.x[1])), found
