"""The likelihood of a fit, of measured noise and a discrepancy, against dense normal algebra."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import block_diag, solve_triangular
from scipy.special import logsumexp
from scipy.stats import multivariate_t
from support.endtoend import SHORT, experiment, fitted
from support.hidden_pads import hidden_pad

from qlvbayes.fitting.fit import fit_pad
from qlvbayes.fitting.marginal_likelihood import (
    Spread,
    discrepancy_of,
    floor_likelihood,
    white_likelihood,
)
from qlvbayes.fitting.optimum import find_start, predictor_of
from qlvbayes.fitting.posterior import Posterior
from qlvbayes.fitting.prediction import Contacts, errors_given_fit
from qlvbayes.inference.density import Point, Terms
from qlvbayes.inference.errors.discrepancy import TOLERANCE, Discrepancy
from qlvbayes.inference.errors.features import UNDECIDED, Features, Locations
from qlvbayes.inference.errors.scatter import UNDECIDED as SCATTER
from qlvbayes.inference.errors.whitening import covariance
from qlvbayes.io.checks import InputError
from qlvbayes.model.choices import Choices
from qlvbayes.model.noise import White
from qlvbayes.priors import LogNormal
from qlvbayes.simulate import TABLE_1
from qlvbayes.simulate.hidden import ViscousDrag

FACTOR, SIZE = -2, -1  # places of these in the noise's constants
CONSTANTS = np.array([TABLE_1["B"].m, TABLE_1["B"].b, *TABLE_1["B"].c, *TABLE_1["B"].v])
LONGER = replace(SHORT, max_steps=1000)


@cache
def two_tests():
    """Pad B at 10 and 20 mm/s, and the blocks of both."""
    trials = tuple(t for t in experiment().trials if round(t.rate) in (10, 20))
    assert len(trials) == 2
    return trials, experiment().record(trials).blocks


def likelihood(*fixed, trials=None):
    noise = Choices(fixed=fixed).build(experiment().scales)[1]
    known, blocks = two_tests()
    made = discrepancy_of(experiment(), trials or known, blocks, noise)
    return floor_likelihood(experiment(), noise, made)


def log_likelihood(own, whole):
    """Of one residual (T, B)."""
    return float(own.log_likelihood(whole[None])[0])


@cache
def dense(floor=None):
    """Covariances of the noise and of a discrepancy of unit size, by their definitions."""
    trials, blocks = two_tests()
    whole = replace(experiment(), floor=floor or experiment().floor)
    noise = []
    for k in range(len(trials)):
        real = np.asarray(blocks.real[k])
        own = type(blocks)(*(np.asarray(x)[k][real] for x in vars(blocks).values()))
        floors, weights = whole.floor.likely()
        of_floors = [covariance(one, own, whole.scales.force) for one in floors]
        noise.append(np.tensordot(weights, of_floors, axes=1))
    places = Locations.from_blocks(whole, trials, blocks)
    shapes = Features.from_locations(places)(places)
    return block_diag(*noise), shapes.T @ shapes + UNDECIDED.rough * np.eye(shapes.shape[1])


def log_normal(x, covariance):
    """Log density of a normal about 0, ten times as fast as scipy's by eigenvectors."""
    root = np.linalg.cholesky(covariance)
    white = solve_triangular(root, x, lower=True)
    return -np.log(np.diag(root)).sum() - 0.5 * (white @ white + x.size * np.log(2.0 * np.pi))


def residuals(seed, sd=0.02):
    """(T, B) in N, and those that are no padding."""
    _, blocks = two_tests()
    real = np.asarray(blocks.real)
    found = np.random.default_rng(seed).normal(0.0, sd, real.shape)
    return found, found[real]


@pytest.mark.parametrize(("size", "factor"), [(0.0, 0.8), (0.02, 1.5)])
def test_each_size_is_a_normal_density_of_all_tests_together(size, factor):
    own = likelihood(f"noise.remainder={size}", f"noise.factor={factor}")
    noise, discrepancy = dense()
    whole, flat = residuals(1)
    expected = log_normal(flat, factor**2 * noise + size**2 * discrepancy)
    assert log_likelihood(own, whole) == pytest.approx(expected, rel=1e-8)


def test_sizes_and_scales_are_summed_with_their_priors():
    own = likelihood()
    noise, discrepancy = dense()
    whole, flat = residuals(2)
    constants = np.asarray(own.constants)
    factors, sizes = np.unique(constants[:, FACTOR]), np.unique(constants[:, SIZE])
    assert factors.size > 1
    shares = sizes[1:] / experiment().scales.force
    falling = 1.0 / (1.0 + shares / TOLERANCE)
    prior = np.concatenate([[0.5], 0.5 * falling / falling.sum()])
    every = [
        log_normal(flat, f**2 * noise + s**2 * discrepancy) + np.log(p / factors.size)
        for f in factors
        for s, p in zip(sizes, prior, strict=True)
    ]
    assert log_likelihood(own, whole) == pytest.approx(logsumexp(every), rel=1e-8)


def test_what_the_user_knows_of_the_noise_leaves_nothing_open():
    """Neither in the likelihood nor in what moves the constants."""
    known = ("noise.white=0.004", "noise.ou=0")
    own = likelihood(*known, "noise.remainder=0")
    floor = replace(experiment().floor, white=0.004, ou=0.0, dwells=None)
    noise, _ = dense(floor)
    whole, flat = residuals(4)
    assert np.asarray(own.constants).tolist() == [[0.004, 0.0, floor.tau, 1.0, 0.0]]
    assert log_likelihood(own, whole) == pytest.approx(log_normal(flat, noise), rel=1e-8)
    spread = find_start(experiment(), Choices(fixed=known), two_tests()[0]).spread
    inverse = np.sort(spread.discrepancy.whitener.precisions)
    np.testing.assert_allclose(1.0 / inverse[::-1], np.linalg.eigvalsh(noise), rtol=1e-8)


@pytest.mark.parametrize(
    ("choices", "said"),
    [
        ({"priors": ("noise.white=lognormal(-5,1)",)}, "noise.white is measured, not fitted"),
        ({"fixed": ("noise.ou=-0.1",)}, "noise.ou must be positive"),
        ({"fixed": ("noise.tau=0",)}, "noise.tau must be positive"),
    ],
)
def test_measured_noise_takes_no_prior_and_no_nonsense(choices, said):
    with pytest.raises(InputError, match=said):
        Choices(**choices).build(experiment().scales)


@pytest.mark.parametrize("width", [0.02, 1.0])
def test_an_independent_noise_is_summed_over_its_sd(width):
    """Against quadrature over the sd, whatever its prior says beside the data."""
    _, blocks = two_tests()
    whole, flat = residuals(6)
    prior = LogNormal(np.log(0.03), width)
    own = white_likelihood(White(prior), blocks, experiment().scales.noise, whole)
    count, extra, timing = (
        np.asarray(x)[_real()] for x in (blocks.count, blocks.extra, blocks.timing)
    )
    sds = np.geomspace(1e-3, 1.0, 5001)
    variances = sds[:, None] ** 2 / count + extra**2 + timing**2
    logs = -0.5 * (np.log(2.0 * np.pi * variances) + flat**2 / variances).sum(axis=1)
    logs += np.asarray(prior.log_density(sds)) + np.log(sds)
    weights = np.exp(logs - logsumexp(logs))
    mean = weights @ sds
    drawn = own.drawn(np.repeat(whole[None], 4000, axis=0), (np.arange(4000) + 0.5) / 4000)
    sd = np.sqrt(weights @ (sds - mean) ** 2)
    assert drawn.mean() == pytest.approx(mean, abs=0.05 * sd)
    assert drawn.std() == pytest.approx(sd, rel=0.05)
    # the log likelihood of another residual, over that of this one
    other, _ = residuals(7)
    less = -0.5 * (other[_real()] ** 2 / variances - flat**2 / variances).sum(axis=1)
    expected = logsumexp(logs + less) - logsumexp(logs)
    found = log_likelihood(own, other) - log_likelihood(own, whole)
    assert found == pytest.approx(expected, abs=1e-3)


def test_draws_of_what_is_summed_over_follow_its_posterior():
    own = likelihood()
    whole, _ = residuals(5, sd=0.012)
    logs = own.log_choices(own.white(whole[None]))[0]
    weights = np.exp(logs - logsumexp(logs))
    count = 500
    shares = (np.arange(count) + 0.5) / count
    drawn = own.drawn(np.repeat(whole[None], count, axis=0), shares)
    for weight, constants in zip(weights, np.asarray(own.constants), strict=True):
        found = np.mean(np.all(drawn == constants, axis=1))
        assert abs(found - weight) <= 1.0 / count  # even shares leave no other error


def posterior_of(own):
    """Return the posterior of the two tests, with this likelihood."""
    of_model = predictor_of(experiment(), Choices(), two_tests()[0])
    return Posterior(of_model.space, of_model.hypothesis, of_model.noise, own)


@cache
def judged(count=1):
    """One residual, seen by draws of a factor 1.2 and a size of 0.02 N; their covariances."""
    own = likelihood("noise.remainder=0.02", "noise.factor=1.2")
    whole, flat = residuals(6)
    choices = own.choices_of(np.repeat(own.constants, count, axis=0))
    noise, discrepancy = dense()
    wholes = np.repeat(whole[None], count, axis=0)
    return own, wholes, choices, flat, 1.2**2 * noise, 0.02**2 * discrepancy


def are_standard(z):
    """Means of many standard normals, and of their squares."""
    assert np.max(np.abs(z.mean(axis=0))) < 5.0 / np.sqrt(len(z))
    assert np.max(np.abs((z**2).mean(axis=0) - 1.0)) < 5.0 * np.sqrt(2.0 / len(z))


def _real():
    return np.asarray(two_tests()[1].real)


def test_each_block_is_conditional_on_the_blocks_before_it():
    own, wholes, choices, flat, noise, discrepancy = judged()
    (logs,) = own.conditional(wholes, choices)
    for k in (1, 2, 40, flat.size):
        heads = log_normal(flat[:k], (noise + discrepancy)[:k, :k])
        assert logs[:k].sum() == pytest.approx(heads, rel=1e-8, abs=1e-8)


def test_replicates_hold_what_is_missed_and_new_noise():
    own, wholes, choices, flat, noise, discrepancy = judged(4000)
    gain = discrepancy @ np.linalg.inv(noise + discrepancy)
    sd = np.sqrt(np.diag(discrepancy - gain @ discrepancy + noise))
    are_standard((own.replicates(wholes, choices, np.random.default_rng(0)) - gain @ flat) / sd)


def test_what_is_missed_elsewhere_is_the_gaussian_process_given_the_fit():
    """At places of a fitted test and of one that was not; by the process's own covariance."""
    trials, blocks = two_tests()
    e = experiment()
    other = next(t for t in e.trials if t not in trials)
    times, names = np.geomspace(0.05, 20.0, 6), [t.name for t in e.trials]
    places = Locations.joined(
        [
            Locations.from_trial(e, t, names.index(t.name), times, np.ones(times.size))
            for t in (trials[0], other)
        ]
    )
    own = likelihood("noise.remainder=0.02", "noise.factor=1.2")
    posterior = posterior_of(own)
    count = 3000
    constants = np.concatenate([CONSTANTS, np.asarray(own.constants)[0]])
    rows = np.repeat(constants[None], count, axis=0)
    contacts, rng = Contacts.from_trials(trials, trials), np.random.default_rng(1)
    draws, _ = errors_given_fit(e, posterior, trials, rows, places, contacts, rng)
    flat = posterior.residuals(rows[:1])[0][_real()]
    here = Locations.from_blocks(e, trials, blocks)
    features = Features.from_locations(here)
    at, there = features(here), features(places)
    cross = 0.02**2 * there.T @ at
    matrix = 1.2**2 * dense()[0] + 0.02**2 * dense()[1]
    gain = cross @ np.linalg.inv(matrix)
    variance = 0.02**2 * (places.size**2 + UNDECIDED.rough) - np.sum(gain * cross, axis=1)
    sds = np.sqrt(variance)
    are_standard((draws - gain @ flat) / sds)
    assert sds[times.size :].min() > sds[: times.size].max()  # an unseen test is known less


def test_a_contact_of_the_fit_is_off_as_the_normal_given_its_residuals_says():
    """Both tests have one contact, and one that was not fitted has it, too."""
    known, blocks = two_tests()
    e = experiment()
    other = next(t for t in e.trials if t not in known)

    def staged(trial):
        return replace(trial, test=replace(trial.test, contact_sd=0.02, contact_stage="one"))

    trials = tuple(map(staged, known))
    real = _real()
    changes = np.where(np.asarray(blocks.real), 0.05 + 0.02 * np.asarray(blocks.force), 0.0)
    posterior = posterior_of(likelihood("noise.remainder=0", "noise.factor=1.2"))
    record = posterior.record
    posterior = posterior.over(replace(record, blocks=replace(record.blocks, stage=changes)))
    count, rng = 4000, np.random.default_rng(3)
    rows = np.repeat(
        np.concatenate([CONSTANTS, [0.006, 0.008, 0.5, 1.2, 0.0]])[None], count, axis=0
    )
    places = Locations.from_trial(e, other, 0, np.ones(1), np.ones(1))
    contacts = Contacts.from_trials([staged(other), other], trials)
    assert contacts.predicted.tolist() == [0, 1]
    draws, errors = errors_given_fit(e, posterior, trials, rows, places, contacts, rng)
    assert not draws.any()
    flat, u = posterior.residuals(rows[:1])[0][real], changes[real]
    gain = u @ np.linalg.inv(dense()[0] + np.outer(u, u))
    are_standard((errors[:, 0] - gain @ flat) / (1.2 * np.sqrt(1.0 - gain @ u)))
    moved, rest = contacts.moved(posterior.record, errors)
    np.testing.assert_allclose(moved[:, 0], errors * changes[0])
    assert not moved[:, 1].any()
    assert not np.asarray(rest.blocks.stage)[0].any()
    np.testing.assert_allclose(np.asarray(rest.blocks.stage)[1], changes[1])


def test_constants_have_the_posterior_that_importance_sampling_finds():
    """From a wide t about the optimum, weighed by the diagnosis's sum over sizes in numpy."""
    found = fitted()
    posterior, own = found.posterior, found.posterior.parameters
    normal = find_start(experiment(), Choices(), found.trials).normal
    proposal = multivariate_t(normal.mean, 1.3 * normal.covariance, df=6)
    theta = proposal.rvs(3000, random_state=1)
    constants, priors = own.bound(theta)
    made = Discrepancy.from_blocks(experiment(), found.trials, posterior.record.blocks)
    white = made.whitener(posterior.residuals(constants))
    logs = logsumexp(made.log_likelihoods(white), axis=1) + priors - proposal.logpdf(theta)
    weights = np.exp(logs - logsumexp(logs))
    worth = 1.0 / np.sum(weights**2)
    assert worth > 500
    mean = weights @ constants
    sd = np.sqrt(weights @ (constants - mean) ** 2)
    summary = found.summary()
    for k, name in enumerate(found.names[:7]):
        # the chain sums over the floor's scale too, which hardly moves the constants
        assert abs(summary[name].mean - mean[k]) < 0.25 * sd[k], name
        assert summary[name].sd == pytest.approx(sd[k], rel=0.15), name


def point(made, slopes, residual, prior, predicted=None):
    """Return a fit of these derivatives (D, T, B) and residuals (T, B)."""
    vectors = made.whitener(np.concatenate([residual[None], slopes]))
    own = SimpleNamespace(length=np.ones(len(slopes)))
    return Point(own, np.zeros(len(slopes)), None, None, predicted, slopes, vectors, prior, None)


def test_constants_are_moved_by_what_a_discrepancy_may_have_moved_them():
    """Compared with least squares: the step squared, and the covariance less that of the curve."""
    rng, size = np.random.default_rng(5), 0.02
    trials, blocks = two_tests()
    made = Discrepancy.from_blocks(experiment(), trials, blocks)
    shape = np.shape(blocks.real)
    slopes = np.where(
        blocks.real, rng.standard_normal((3, *shape)) * [[[0.1]], [[0.3]], [[1.0]]], 0.0
    )
    whole, flat = residuals(6, 0.05)
    gradient, prior = np.array([0.3, -0.2, 0.0]), np.diag([4.0, 1e8, 0.0])
    left = np.where(blocks.real, whole, 0.0)
    spread = Spread.about(made, point(made, slopes, left, Terms(0.0, gradient, prior)))
    rows, (noise, discrepancy) = made.whitener.flattened(slopes), dense()
    basis = np.linalg.qr(rows.T)[0]
    rest = np.eye(len(discrepancy)) - basis @ basis.T
    timing = np.diag(np.concatenate(made.whitener.timing))
    ties = basis @ basis.T @ timing @ rest
    rough = UNDECIDED.rough * np.eye(len(discrepancy))  # says nothing of one block by another
    apart = noise - ties - ties.T + size**2 * (rest @ (discrepancy - rough) @ rest + rough)
    whole, followed = (
        np.linalg.inv(rows @ np.linalg.solve(one, rows.T) + prior + np.eye(3))
        for one in (noise + size**2 * discrepancy, apart)
    )
    step = whole @ (rows @ np.linalg.solve(noise + size**2 * discrepancy, flat) - gradient)
    step /= max(1.0, np.abs(step).max())
    values, axes = np.linalg.eigh(whole + np.outer(step, step) - followed)
    expected = (axes * np.maximum(values, 0.0)) @ axes.T
    np.testing.assert_allclose(spread.covariance(size), expected, atol=1e-7 * values.max())
    draws = spread.draws(np.full(40_000, size), rng)
    np.testing.assert_allclose(draws.T @ draws / len(draws), expected, atol=0.03 * values.max())
    assert not spread.draws(np.zeros(5), rng).any()


def test_constants_are_moved_by_a_stiffness_that_differs_from_test_to_test():
    """A scale of one test's force that is no constant of the model spreads the mean scale."""
    trials, blocks = two_tests()
    made = replace(Discrepancy.from_blocks(experiment(), trials, blocks), scatter=SCATTER)
    predicted = np.where(blocks.real, 1.0, 0.0)
    scales = np.array([0.3, -0.3])[:, None]
    prior = Terms(0.0, np.zeros(1), np.zeros((1, 1)))
    # the derivative by ln m is the force
    spread = Spread.about(made, point(made, predicted[None], scales * predicted, prior, predicted))
    assert 0.2 < spread.scatter <= 0.5
    sd = np.sqrt(spread.covariance(0.0)[0, 0])
    assert sd == pytest.approx(spread.scatter / np.sqrt(2.0), rel=0.3)
    assert spread.draws(np.zeros(5), np.random.default_rng(0)).all()
    alike = point(made, predicted[None], 0.0 * predicted, prior, predicted)
    same = Spread.about(made, alike)
    assert same.scatter == 0.0
    assert not same.draws(np.zeros(5), np.random.default_rng(0)).any()


@pytest.mark.slow
def test_a_hidden_effect_widens_the_intervals_and_is_told_in_newtons():
    rates = (20.0,)
    plain = fit_pad(hidden_pad(rates=rates), Choices(), settings=LONGER).summary()
    drag = hidden_pad(ViscousDrag(eta=0.004), rates=rates)  # 0.08 N while it moves
    found = fit_pad(drag, Choices(), settings=LONGER).summary()
    sizes = [s["noise.remainder"] for s in (plain, found)]
    assert sizes[0].median < drag.floor.total < 0.08
    assert sizes[1].hdi90[0] > sizes[0].median
    for name in ("m", "b", "c[0]", "v[1]"):
        assert found[name].sd > plain[name].sd, name
