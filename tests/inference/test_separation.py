"""A discrepancy separated from what a model can follow: what that promises."""

import numpy as np
import pytest

from qlvbayes.diagnosis.searchsetup import build_search
from qlvbayes.effects.catalogue import find
from qlvbayes.inference.density import Terms
from qlvbayes.inference.errors.discrepancy import Discrepancy
from qlvbayes.inference.errors.features import UNDECIDED
from qlvbayes.inference.errors.whitening import Whitener
from qlvbayes.inference.evidence import second_moment

COUNT, FREE = 60, 4  # block means of two tests, free numbers
X = np.linspace(0.0, 1.0, COUNT)


def smooth_features():
    """A discrepancy that bends slowly over the record: ten functions of unit size."""
    return np.array([np.cos(np.pi * k * X) / (1.0 + k) for k in range(10)])


def whitener(noise, timing=None):
    """Return the whitener of noise and of uncertain moments (n,), both variances."""
    half = COUNT // 2
    everything = np.ones(half, dtype=bool)
    timing = np.zeros(COUNT) if timing is None else timing
    whole = noise + np.diag(timing)
    parts = (whole[:half, :half], whole[half:, half:])
    return Whitener((everything, everything), parts, (timing[:half], timing[half:]))


def by_test(rows):
    return rows.reshape(len(rows), 2, COUNT // 2)


def correlated(sd, memory):
    gap = np.abs(np.subtract.outer(np.arange(COUNT // 2), np.arange(COUNT // 2)))
    one = sd**2 * (0.7 * np.exp(-gap / memory) + 0.3 * np.eye(COUNT // 2))
    return np.block([[one, np.zeros_like(one)], [np.zeros_like(one), 1.3 * one]])


def made(noise, timing=None):
    return Discrepancy.from_features(by_test(smooth_features()), whitener(noise, timing), 1.0, 0.01)


def estimate(found, separation, jacobian, size, data):
    """Most probable numbers of a linear model, without a prior."""
    own = found.at(size, separation)
    vectors = found.whitener(by_test(np.concatenate([data[None], jacobian])))
    products = own.products(vectors)
    return np.linalg.solve(products[1:, 1:], products[1:, 0])


def test_beside_a_large_discrepancy_the_curve_is_that_of_least_squares():
    """If it is not separated the curve may lie elsewhere: its error is larger."""
    rng = np.random.default_rng(4)
    jacobian = np.array([X**k for k in range(3)])
    timing = np.where(np.arange(COUNT) % 20 == 10, 0.3**2, 0.0)  # three readings next to kinks
    found = made(correlated(1e-3, 5.0), timing)
    misfit = 0.3 * np.sin(7.0 * X) * X + 0.02 * rng.standard_normal(COUNT)
    separation = found.separated(by_test(jacobian), np.ones(3))
    squares = np.linalg.lstsq(jacobian.T, misfit, rcond=None)[0]
    separated = estimate(found, separation, jacobian, 0.3, misfit)
    free = estimate(found, None, jacobian, 0.3, misfit)
    least, own, other = (
        np.sqrt(np.mean((misfit - x @ jacobian) ** 2)) for x in (squares, separated, free)
    )
    assert own < 1.0001 * least
    assert other > 1.05 * least


def test_numbers_are_off_by_what_a_discrepancy_has_moved_them():
    """Least squares of misfit drawn anew: the second moment holds the truth as it says, on average.

    What a fit has followed is known from what it has not: about the fitted numbers the truth lies
    at the step, to within the inverse curvature.
    """
    rng = np.random.default_rng(7)
    jacobian, size, count = np.array([np.ones(COUNT), X, X**2]), 0.02, 2000
    found = made(correlated(1e-3, 5.0))
    smooth = rng.standard_normal((count, 10)) @ smooth_features()
    drawn = size * (smooth + np.sqrt(UNDECIDED.rough) * rng.standard_normal((count, COUNT)))
    fitted = np.linalg.lstsq(jacobian.T, drawn.T, rcond=None)[0]
    left = drawn - fitted.T @ jacobian
    vectors = found.whitener(by_test(np.concatenate([jacobian, left])))
    products = found.at(size).products(vectors)
    lengths = np.full(3, 10.0)
    z, covered = [], []
    for k in range(count):
        gradient, curvature = -products[:3, 3 + k], products[:3, :3]
        second = second_moment(Terms(0.0, gradient, curvature), lengths)
        step = np.linalg.solve(curvature + np.diag(lengths**-2), -gradient)
        apart = -fitted[:, k] - step  # the true numbers are nothing
        z.append(apart / np.sqrt(np.diag(np.linalg.inv(curvature))))
        covered.append(np.abs(fitted[:, k]) < 1.645 * np.sqrt(np.diag(second)))
    assert np.max(np.abs(np.mean(z, axis=0))) < 5.0 / np.sqrt(count)
    np.testing.assert_allclose(np.std(z, axis=0), 1.0, atol=0.1)
    shares = np.mean(covered, axis=0)
    assert np.max(np.abs(shares - 0.9)) < 4.0 * np.sqrt(0.09 / count)


def test_no_number_is_moved_by_more_than_its_natural_length():
    lengths = np.array([2.0, 0.5])
    second = second_moment(Terms(0.0, np.array([1e3, -1e3]), 1e-6 * np.eye(2)), lengths)
    assert np.all(np.sqrt(np.diag(second)) <= 1.5 * lengths)
    assert np.all(np.linalg.eigvalsh(second) > 0.0)


def test_a_model_without_slopes_leaves_the_discrepancy_as_it_is():
    found = made(correlated(0.01, 5.0))
    separation = found.separated(by_test(np.zeros((2, COUNT))), np.ones(2))
    assert len(separation.rows) == 0
    size = float(found.sizes[3])
    assert found.at(size, separation) is found.at(size)


@pytest.mark.parametrize("name", ["viscous_drag", "fluid_pressure", "stress_softening"])
@pytest.mark.few(1)
def test_an_effect_that_is_not_there_leaves_the_density_as_it_is(experiment, name):
    """At its bound an amplitude can follow nothing, so that it takes nothing of a discrepancy."""
    search = build_search(experiment, kinds=[find(name)])
    density, plain = search.density, search.baseline
    own = density.space.parameters(plain)
    theta = np.median(density.space.prior_draws(plain), axis=0)
    more = density.space.parameters(plain.plus(name))
    with_it = np.median(density.space.prior_draws(plain.plus(name)), axis=0)
    with_it[more.positions_of(own)] = theta
    with_it[more.amplitude_of[name].number] = 0.0
    points = [density.at(plain, theta), density.at(plain.plus(name), with_it)]
    size = density.discrepancy.sizes[5]
    losses = [density.loss(one, size, one.separation) - one.prior.loss for one in points]
    assert losses[1] == pytest.approx(losses[0], rel=1e-9)
