r"""The strength of an effect in each test, and how much of its force one strength makes.

The force e(x) that an effect adds at a mode is allowed to be stronger or weaker in each test k (in
each phase, where there is only one test),

.. math:: e_k(x)\,(1 + \delta_k), \qquad \delta_k \sim N(0, \tau^2).

With V its parts, J and H the Jacobian and curvature of the hypothesis, and C the covariance of
noise, discrepancy and all other scatter, to the first order (partial pooling; Laird & Ware 1982,
doi:10.2307/2529876)

.. math:: A = V C^{-1} V^T - V C^{-1} J^T H^{-1} J C^{-1} V^T, \quad b = V C^{-1} r, \quad
          \delta \mid \tau \sim N\left((A + \tau^{-2})^{-1} b,\ (A + \tau^{-2})^{-1}\right)

among the deviations whose mean over the force is zero. The likeliest tau is the effect's scatter.
Real strengths do differ, as adhesion does with the depth of the press. What matters is how much of
the force depends on that,

.. math:: \text{agreement} = \max\left(0,\ 1 - \frac{\sum_k |e_k|^2 \delta_k^2}
          {\sum_k |e_k|^2 (1 + \delta_k)^2}\right),

which is 1 for one strength everywhere, and below a half where the strengths scatter by their own
size or change sign, as those of something that merely looks like the effect.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import null_space
from scipy.stats import spearmanr

from qlvbayes.diagnosis.candidate import Candidate
from qlvbayes.diagnosis.checks.samples import Samples
from qlvbayes.diagnosis.result import Strength, Strengths
from qlvbayes.diagnosis.settings import Imitation
from qlvbayes.inference.density import Density
from qlvbayes.inference.errors.scatter import Scatter, by_test, likeliest
from qlvbayes.inference.starts import amplitude_of, without
from qlvbayes.io.arrays import Array
from qlvbayes.motion.experiment import Trial
from qlvbayes.motion.phases import NAMES, phase_index


def strengths(
    density: Density, samples: Samples, candidate: Candidate, effect: str, imitation: Imitation
) -> Strengths | None:
    """Return the strengths of one effect of a candidate; None where it has only one part."""
    point, space = candidate.point, density.space
    rest = space.forces(*without(space, point, effect))[0]
    names, parts = _parts(samples, np.where(space.real, point.predicted - rest, 0.0))
    if len(parts) < 2:
        return None
    own = _without_own_scatter(candidate, effect)
    sized = density.discrepancy.at(candidate.mode.size, point.separation.with_scatter(own))
    _, gradient, curvature = point.added_terms(density.whitener(parts), sized)
    squares = np.sum(parts**2, axis=(1, 2))
    delta, sds, spread = pooled(curvature, -gradient, squares, imitation)
    return Strengths(
        spread=spread,
        agreement=agreement(squares, delta),
        parts=tuple(
            Strength(name, float(1.0 + d), float(sd), float(share))
            for name, d, sd, share in zip(names, delta, sds, squares / squares.sum(), strict=True)
        ),
        grows_with=_trend(samples.trials, delta, sds, imitation) if spread > 0.0 else None,
    )


def pooled(
    curvature: Array, slope: Array, squares: Array, imitation: Imitation
) -> tuple[Array, Array, float]:
    """Return the deviations (K,) of K strengths, their sds (K,), and the likeliest tau."""
    apart = null_space(squares[None] / np.max(squares))
    inner, along = apart.T @ (0.5 * (curvature + curvature.T)) @ apart, apart.T @ slope
    _, found = likeliest(inner, along, np.zeros(along.size, dtype=np.intp), imitation.prior)
    (spread,) = found.sizes
    if spread == 0.0:
        return np.zeros(slope.size), np.zeros(slope.size), 0.0
    covariance = np.linalg.inv(inner + np.eye(along.size) / spread**2)
    sds = np.sqrt(np.einsum("kz,zy,ky->k", apart, covariance, apart))
    return apart @ (covariance @ along), sds, spread


def agreement(squares: Array, deviations: Array) -> float:
    """Return the share of the force that one strength makes, from |e_k|^2 (K,) and delta (K,)."""
    whole = float(squares @ (1.0 + deviations) ** 2)
    if whole == 0.0:
        return 0.0
    return max(0.0, 1.0 - float(squares @ deviations**2) / whole)


def _without_own_scatter(candidate: Candidate, effect: str) -> Scatter:
    """Return the scatter of a candidate without that of one of its effects."""
    own, scatter = candidate.point.own, candidate.point.separation.scatter
    amplitude = amplitude_of(own, effect)
    if amplitude is None or not scatter.sizes:
        return scatter
    sizes = list(scatter.sizes)
    sizes[1 + own.amplitudes.index(amplitude.number)] = 0.0
    return Scatter(tuple(sizes), scatter.cost)


def _parts(samples: Samples, force: Array) -> tuple[list[str], Array]:
    """Return the names and the parts (K, T, B) of a force (T, B): its tests, or a test's phases."""
    if len(samples.trials) > 1:
        names, parts = [trial.name for trial in samples.trials], by_test(force[None])
    else:
        (trial,) = samples.trials
        blocks = samples.space.record.blocks
        middle = 0.5 * (np.asarray(blocks.first) + np.asarray(blocks.last))
        which = phase_index(trial.phases, middle[0])
        names = [f"{NAMES[one.kind]} from {one.start:.4g} s" for one in trial.phases]
        parts = np.where(which == np.arange(len(names))[:, None], force[0], 0.0)[:, None]
    acts = np.any(parts != 0.0, axis=(1, 2))
    return [name for name, here in zip(names, acts, strict=True) if here], parts[acts]


def _trend(trials: Sequence[Trial], delta: Array, sds: Array, imitation: Imitation) -> str | None:
    """Return what the strengths of tests grow or fall with, where that is clear."""
    if len(trials) != delta.size or delta.size < imitation.ranked:
        return None
    depths = [float(np.max(np.abs(trial.test.displacement))) for trial in trials]
    for word, values in (("depth", depths), ("speed", [float(t.rate) for t in trials])):
        if np.ptp(values) == 0.0 or not np.all(np.isfinite(values)):
            continue
        rank = float(spearmanr(values, delta).statistic)
        if abs(rank) >= imitation.rank and np.ptp(delta) > 2.0 * float(np.median(sds)):
            return f"grows with {word}" if rank > 0.0 else f"falls with {word}"
    return None
