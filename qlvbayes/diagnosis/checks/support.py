"""The support for an effect: what else than its evidence speaks for it, and how sure that makes.

All figures compare the most probable hypothesis that has the effect with the same without it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import jax
import numpy as np
from msgspec import structs
from scipy.linalg import cholesky, null_space, solve_triangular
from scipy.stats import spearmanr

from qlvbayes.diagnosis.candidate import Candidate
from qlvbayes.diagnosis.certainty import LEAST, certainty
from qlvbayes.diagnosis.checks.outcome import REPORTED, SearchOutcome
from qlvbayes.diagnosis.checks.samples import Samples
from qlvbayes.diagnosis.result import Decisive, Ranked, Strength, Strengths, Support
from qlvbayes.diagnosis.settings import Imitation
from qlvbayes.inference.density import Density
from qlvbayes.inference.errors.scatter import Scatter, by_test, likeliest
from qlvbayes.inference.starts import without
from qlvbayes.io.arrays import Array, finite_or_none
from qlvbayes.motion.experiment import Trial
from qlvbayes.motion.phases import NAMES, phase_index


def supported(outcome: SearchOutcome) -> tuple[Ranked, ...]:
    """Return the ranking with the support for each probable effect, and with its certainty."""
    ranking = [
        (structs.replace(one, half=_half(outcome, one, index)), index)
        for one, index in outcome.ranking()
    ]
    return tuple(
        one if one.effect == "none" or one.inclusion < LEAST else with_support(outcome, one, index)
        for one, index in ranking
    )


def _half(outcome: SearchOutcome, ranked: Ranked, index: int) -> Decisive | None:
    """Return in how many readings half of an effect's evidence lies, where that is known."""
    if ranked.effect == "none" or ranked.inclusion < REPORTED:
        return None
    having, search = outcome.candidates[index], outcome.search
    less = search.candidates.get(having.hypothesis.less(outcome.form(index, ranked.effect)))
    return decisive(search.density, outcome.experiment.trials, having, less) if less else None


def with_support(outcome: SearchOutcome, ranked: Ranked, index: int) -> Ranked:
    """Return an effect with the support for it, and its certainty, in one hypothesis."""
    own = support(outcome, ranked.effect, index)
    sure = certainty(ranked.inclusion, ranked.log_bayes_factor, own)
    if own is not None and own.heldout is None:  # it adds no force
        sure = 0.0
    if ranked.effect in outcome.measured:
        sure = max(sure or 0.0, outcome.search.settings.measured)
    return structs.replace(ranked, support=own, certainty=sure)


def support(outcome: SearchOutcome, effect: str, index: int) -> Support | None:
    r"""Return the support for an effect in a hypothesis that has it.

    The errors on tests left out count where the effect acts: with e the force that it adds and r
    the residual of a test by a fit to all others, over the samples of the n parts left out,

    .. math:: E^2 = \frac{\sum e^2 r^2}{\sum e^2}, \quad
              \text{gain} = \ln \frac{E_{without}}{E_{with}}, \quad
              \text{sds} = \frac{\bar d}{s_d / \sqrt n},\ d = \sum_{part}
              e^2 (r_{without}^2 - r_{with}^2).

    A drag acts in ramps, which have few of the samples: what something unlisted does in long holds
    says nothing about it.
    """
    search, samples = outcome.search, outcome.samples
    having, form = outcome.candidates[index], outcome.form(index, effect)
    less = search.without(having, effect)
    if less is None:
        return None
    weights = [np.square(one) for one in outcome.acting(having, form)]
    total = float(sum(one.sum() for one in weights))
    adds = total > 0.0 and math.isfinite(total)
    before, after = (
        np.array([w @ np.square(part.residual) for w, part in zip(weights, left, strict=True)])
        for left in map(outcome.left_out, (less, having))
    )
    error = samples.error(outcome.residuals(having))
    return Support(
        heldout_gain=0.5 * _log_ratio(float(before.sum()), float(after.sum())),
        heldout_sds=_paired(before - after),
        heldout=finite_or_none(math.sqrt(float(after.sum()) / total)) if adds else None,
        error_left=_log_ratio(error, outcome.experiment.floor.total),
        p_left=outcome.adequacy(having).p_value,
        effects=len(search.added(having.hypothesis)),
        strengths=strengths(search.density, samples, having, form, search.settings.imitation),
    )


def _log_ratio(first: float, second: float) -> float:
    """Return ln(first / second); 0 where it is not finite."""
    return math.log(first / second) if first > 0.0 and second > 0.0 else 0.0


def _paired(falls: Array) -> float:
    """Return the mean of falls (n,) over its standard error; 0 of fewer than three parts."""
    if falls.size < 3 or not np.isfinite(falls).all():
        return 0.0
    error = falls.std(ddof=1) / math.sqrt(falls.size)
    return float(falls.mean() / error) if error > 0.0 else 0.0


def strengths(
    density: Density, samples: Samples, candidate: Candidate, effect: str, imitation: Imitation
) -> Strengths | None:
    r"""Return the strengths of one effect of a candidate; None where it has only one part.

    The force e(x) that an effect adds at a mode is allowed to be stronger or weaker in each test k
    (in each phase, where there is only one test),

    .. math:: e_k(x)\,(1 + \delta_k), \qquad \delta_k \sim N(0, \tau^2).

    With V its parts, J and H the Jacobian and curvature of the hypothesis, and C the covariance of
    noise, discrepancy and all other scatter, to the first order (partial pooling; Laird & Ware
    1982, doi:10.2307/2529876)

    .. math:: A = V C^{-1} V^T - V C^{-1} J^T H^{-1} J C^{-1} V^T, \quad b = V C^{-1} r, \quad
              \delta \mid \tau \sim N\left((A + \tau^{-2})^{-1} b,\ (A + \tau^{-2})^{-1}\right)

    among the deviations whose mean over the force is zero. The likeliest tau is the effect's
    scatter. Real strengths do differ, as adhesion does with the depth of the press. What matters is
    how much of the force depends on that,

    .. math:: \text{agreement} = \max\left(0,\ 1 - \frac{\sum_k |e_k|^2 \delta_k^2}
              {\sum_k |e_k|^2 (1 + \delta_k)^2}\right),

    which is 1 for one strength everywhere, and below a half where the strengths scatter by their
    own size or change sign, as those of something that merely looks like the effect.
    """
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
    amplitude = own.amplitude_of.get(effect)
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


def decisive(
    density: Density, trials: Sequence[Trial], candidate: Candidate, without: Candidate
) -> Decisive | None:
    r"""Return the fewest block means that hold half of the evidence for an effect.

    With C = L L^T the covariance of noise and discrepancy of a hypothesis at its likeliest size,
    the log likelihood is a sum over the block means, each given the ones before it in its test,

    .. math:: \ln p(y_k \mid y_1 \dots y_{k-1}) = -\tfrac12 z_k^2 - \ln L_{kk} - \tfrac12 \ln 2 \pi,
              \quad z = L^{-1} (y - f)

    The differences between a hypothesis with an effect and the same without it, the largest first,
    say how many block means hold half of the gain in log likelihood. For an effect that acts in
    whole phases there are many; evidence that lies in a handful of them may as well be a fault of
    these readings.
    """
    gains = log_densities(density, candidate) - log_densities(density, without)
    if not gains.sum() > 0.0:
        return None
    blocks = jax.tree.map(np.asarray, density.space.record.blocks)
    middle = density.whitener.flattened(0.5 * (blocks.first + blocks.last)[None])[0]
    first = int(np.argmax(gains))
    trial = trials[int(density.whitener.tests[first])]
    phase = trial.phases[int(phase_index(trial.phases, middle[first : first + 1])[0])]
    return Decisive(
        blocks=fewest(gains),
        of=gains.size,
        test=trial.name,
        phase=phase.kind,
        time=float(middle[first]),
    )


def log_densities(density: Density, candidate: Candidate) -> Array:
    """Return the log density (n,) of every block mean given those before it, at a mode."""
    whitener, point = density.whitener, candidate.point
    force = np.asarray(density.space.record.blocks.force)
    left = whitener.flattened((force - point.predicted)[None])[0]
    rough = density.discrepancy.rough
    covariance = whitener.covariance + point.separation.covariance(candidate.mode.size, rough)
    root = cholesky(covariance, lower=True, check_finite=False)
    errors = solve_triangular(root, left, lower=True, check_finite=False)
    return np.asarray(-0.5 * errors**2 - np.log(np.diag(root)) - 0.5 * np.log(2.0 * np.pi))


def fewest(gains: Array) -> int:
    """Return how many of the gains (n,) at least add up to half of their sum, which is above 0."""
    sums = np.cumsum(np.sort(gains)[::-1])
    return int(np.searchsorted(sums, 0.5 * gains.sum())) + 1
