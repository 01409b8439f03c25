"""Several specimens of each fluid: the hierarchical model against a dense reference."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import halfcauchy, multivariate_normal
from support.posteriors import PLACES, WIDTHS, posterior, table_1

from qlvbayes.comparison.compare import compare
from qlvbayes.comparison.statistics import SPREAD, Specimens, fluid_draws, spread_posterior
from qlvbayes.io.checks import InputError

MEANS = (np.array([1.0, 1.3, 0.9]), np.array([1.6, 1.7]))
SDS = (np.array([0.1, 0.05, 0.2]), np.array([0.1, 0.3]))
SIZE = 0.3917  # mean over the fluids of abs(y - 1)
SCALE = SPREAD * SIZE


@pytest.fixture(scope="module")
def reference():
    """Moments of the fluids' own values and of the spread, by adaptive quadrature over the spread.

    Given the spread, y is normal about the fluid's value, whose prior is a very wide normal.
    """
    wide = 1e3

    def joint(tau, power, fluid=None):
        density, moment = halfcauchy.pdf(tau, scale=SCALE), tau**power
        for k, (y, s) in enumerate(zip(MEANS, SDS, strict=True)):
            cov = np.diag(s**2 + tau**2) + wide**2
            density *= multivariate_normal.pdf(y, np.zeros(len(y)), cov)
            if k == fluid:
                weights = np.linalg.solve(cov, np.full(len(y), wide**2))
                mean = weights @ y
                variance = wide**2 - weights @ np.full(len(y), wide**2)
                moment = mean if power == 1 else variance + mean**2
        return density * moment

    edges = [0.02, 0.1, 0.3, 1.0, 3.0]
    area = lambda *a: quad(joint, 0.0, 200.0, args=a, points=edges, limit=500)[0]  # noqa: E731
    total = area(0)
    return {
        "means": [area(1, k) / total for k in (0, 1)],
        "squares": [area(2, k) / total for k in (0, 1)],
        "below": quad(joint, 0.0, 0.3, args=(0,), points=edges[:2], limit=500)[0] / total,
    }


def test_fluids_have_the_means_sds_and_spread_of_the_dense_integral(reference):
    groups = [Specimens(y, s) for y, s in zip(MEANS, SDS, strict=True)]
    spreads, weights = spread_posterior(groups, SCALE)
    assert weights[spreads < 0.3].sum() == pytest.approx(reference["below"], abs=2e-3)
    # draws of specimens that have exactly these means and sds; some are negative: no logarithm
    rng = np.random.default_rng(0)
    base = rng.standard_normal(500)
    base = (base - base.mean()) / base.std()
    # a shift moves everything along, and makes the numbers change their sign
    groups = [
        [y - 1.0 + s * base for y, s in zip(ys, ss, strict=True)]
        for ys, ss in zip(MEANS, SDS, strict=True)
    ]
    size = np.mean([np.mean(np.abs(y - 1.0)) for y in MEANS])
    assert size == pytest.approx(SIZE, abs=1e-4)
    draws = fluid_draws(groups, rng)
    for k, found in enumerate(draws):
        exact = reference["means"][k] - 1.0
        sd = np.sqrt(reference["squares"][k] - reference["means"][k] ** 2)
        # four standard errors of 4000 draws, whose tails are long
        assert np.mean(found) == pytest.approx(exact, abs=4.0 * sd / np.sqrt(len(found)))
        assert np.std(found) == pytest.approx(sd, rel=0.15)


def simulate(truth, spread, count, rng):
    """Specimens of one fluid: every constant with its own log-normal spread."""
    return [
        posterior(
            {k: v * np.exp(spread * rng.standard_normal()) for k, v in truth.items()}, rng, size=100
        )
        for _ in range(count)
    ]


def test_fluids_are_compared_with_the_spread_of_their_specimens():
    rng = np.random.default_rng(2)
    groups = [simulate(table_1(pad), 0.05, 3, rng) for pad in "BC"]
    fluids = compare(*groups, names=("oil", "glycerin"), **PLACES)
    assert (fluids.between, fluids.specimens, fluids.differ) == ("fluids", (3, 3), True)
    assert fluids["m"].answer == "less"
    # far wider than one specimen's own interval: specimens spread by 5 %, their posteriors by 1 %
    value = fluids["m"].first
    assert value.high / value.low > np.exp(2 * 1.645 * 1.5 * WIDTHS["m"])
    with pytest.raises(InputError, match="1 and 2 specimens"):
        compare(groups[0][0], groups[1][:2], **PLACES)


@pytest.mark.slow
def test_specimens_alone_make_two_pads_differ_but_not_two_fluids():
    rng = np.random.default_rng(3)
    truth = table_1("B")
    one, other = (simulate(truth, 0.2, 4, rng) for _ in range(2))
    pads = compare(one[0], other[0], **PLACES)
    assert pads.between == "pads"
    assert pads.differ is True
    assert any("how much specimens of one kind differ is not known" in n for n in pads.notices)
    assert compare(one, other, **PLACES).differ is not True
