"""The sampler against posteriors that are known, its proposals, and its chain on disk."""

from dataclasses import replace
from types import SimpleNamespace

import emcee
import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.special import logsumexp
from scipy.stats import beta, multivariate_t, norm
from support.endtoend import experiment
from support.posteriors import build_posterior

from qlvbayes.fitting.coordinates import TAIL, KernelProposal, from_draws, from_normal
from qlvbayes.fitting.ensemble import (
    ChainStore,
    Settings,
    autocorrelation_time,
    diagnose_chain,
    highest_density,
    key_of,
    remove_chain,
    sample,
)
from qlvbayes.fitting.least_squares import NormalApproximation
from qlvbayes.model.choices import Choices
from qlvbayes.model.parameters import draw_priors

RNG = 20
DRAWN = 5000  # rates, from their prior
STEPS = Settings(min_steps=100, stretch=20, max_steps=4000)


@pytest.fixture(scope="module")
def uninformed():
    """A posterior that is its prior: the noise drowns the data."""
    priors = ("m=lognormal(0,0.5)", "b=lognormal(-1,0.5)")
    choices = Choices(noise="white", priors=priors, fixed="noise.white=1e7")
    return build_posterior(experiment(), choices, experiment().with_role("fit"))


@pytest.fixture(scope="module")
def start(uninformed):
    rng = np.random.default_rng(RNG)
    draws = draw_priors(uninformed.model, 2000, rng)
    return NormalApproximation(draws.mean(axis=0), np.cov(draws, rowvar=False))


@pytest.fixture(scope="module")
def chain(uninformed, start):
    return sample(uninformed, start, STEPS)


def prior_quantiles(rates, name, shares):
    if name == "m":
        return np.exp(norm.ppf(shares, 0.0, 0.5))
    if name == "b":
        return np.exp(norm.ppf(shares, -1.0, 0.5))
    if name.startswith("c"):
        return beta.ppf(shares, 1.0, 2.0)
    return np.quantile(rates, shares, axis=0)[:, int(name[2]) - 1]


@pytest.mark.slow
def test_without_information_the_prior_comes_out(uninformed, chain):
    theta = np.swapaxes(chain.theta, 0, 1)
    values = uninformed.parameters.constants(theta.reshape(-1, theta.shape[-1]))
    constants = values.reshape(*theta.shape[:2], -1)  # (walkers, steps, P)
    # the order of the rates makes their prior no textbook's
    rng = np.random.default_rng(RNG + 1)
    rates = np.array([uninformed.model.relaxation.v.draw(rng) for _ in range(DRAWN)])
    shares = np.array([0.05, 0.25, 0.5, 0.75, 0.95])
    ess = diagnose_chain(constants).ess_bulk
    for k, name in enumerate(uninformed.names[:-1]):
        expected = prior_quantiles(rates, name, shares)
        found = np.array([np.mean(constants[..., k] < q) for q in expected])
        # effective draws of the chain, and those of the rates
        error = np.sqrt(shares * (1.0 - shares) * (1.0 / ess[k] + 1.0 / DRAWN))
        assert np.all(np.abs(found - shares) < 4.5 * error), name


def test_the_chain_is_enough_and_has_the_densities_of_the_posterior(chain, uninformed):
    assert chain.enough
    assert len(chain.theta) >= 50.0 * chain.autocorrelation
    assert chain.steps % STEPS.stretch == 0
    assert 0.1 < chain.acceptance < 0.9
    last = uninformed.log_density(chain.theta[-1])
    np.testing.assert_allclose(chain.log_density[-1], last, rtol=1e-12)


def test_too_few_steps_are_not_enough_and_a_seed_repeats(uninformed, start):
    settings = replace(STEPS, max_steps=40)
    short = sample(uninformed, start, settings)
    assert short.steps == 40
    assert not short.enough
    again = sample(uninformed, start, settings)
    other = sample(uninformed, start, replace(settings, seed=1))
    np.testing.assert_array_equal(short.theta, again.theta)
    assert not np.array_equal(short.theta, other.theta)


class Killed(BaseException):
    """Exception that ends a run in the middle."""


def sample_killed(steps, posterior, start, settings, store):
    """Sample a chain that is killed once at each of some steps, and goes on."""
    for step in steps:

        def progress(done, expected, step=step):
            if done >= step:
                raise Killed

        with pytest.raises(Killed):
            sample(posterior, start, settings, store, progress)
    return sample(posterior, start, settings, store)


def test_a_killed_chain_resumes_bitwise(uninformed, start, tmp_path):
    settings = replace(STEPS, max_steps=120)
    chain = sample(uninformed, start, settings)
    store = ChainStore(tmp_path / "chain", key_of(uninformed, settings))
    resumed = sample_killed((20, 60), uninformed, start, settings, store)
    np.testing.assert_array_equal(resumed.theta, chain.theta)
    np.testing.assert_array_equal(resumed.log_density, chain.log_density)
    assert (resumed.steps, resumed.acceptance) == (chain.steps, chain.acceptance)


@pytest.mark.slow
def test_a_resumed_chain_is_not_looked_at_more_often(uninformed, start, tmp_path, monkeypatch):
    """Else a stopped run would end sooner, at a length that favours luck."""
    looks = []

    def never_enough(chains):
        looks.append(chains.shape[1])
        return SimpleNamespace(troubles=["not yet"])

    monkeypatch.setattr("qlvbayes.fitting.ensemble.diagnose_chain", never_enough)
    settings = replace(STEPS, max_steps=1200)
    sample(uninformed, start, settings)
    uninterrupted, looks[:] = list(looks), []
    store = ChainStore(tmp_path / "chain", key_of(uninformed, settings))
    sample_killed((620, 740, 900, 1180), uninformed, start, settings, store)
    assert sorted(set(looks)) == sorted(set(uninterrupted))


def test_a_damaged_stretch_is_sampled_again_and_another_runs_chain_not_resumed(
    uninformed, start, tmp_path
):
    settings, folder = replace(STEPS, max_steps=60), tmp_path / "chain"
    store = ChainStore(folder, key_of(uninformed, settings))
    whole = sample(uninformed, start, settings, store)
    last = folder / "stretch-00002.npz"
    for content in (b"", last.read_bytes()[:-500], b"text"):
        last.write_bytes(content)
        assert len(list(store.load())) == 2
        np.testing.assert_array_equal(sample(uninformed, start, settings, store).theta, whole.theta)
    other = replace(settings, seed=9)
    store = ChainStore(folder, key_of(uninformed, other))
    assert list(store.load()) == []
    stored = sample(uninformed, start, other, store)
    np.testing.assert_array_equal(stored.theta, sample(uninformed, start, other).theta)
    assert len(list(store.load())) == 3
    remove_chain(folder)
    assert not folder.exists()
    remove_chain(folder)
    folder.write_text("in the way")
    with pytest.raises(OSError, match="chain"):
        sample(uninformed, start, settings, ChainStore(folder / "deeper", "key"))


def test_a_chains_key_knows_all_that_it_depends_on():
    trials = experiment().with_role("fit")

    def key(settings=STEPS, trials=trials, **choices):
        return key_of(build_posterior(experiment(), Choices(**choices), trials), settings)

    keys = [
        key(), key(bonded=True), key(elastic="linear"), key(modes=1), key(noise="white"),
        key(priors=("m=lognormal(0,1)",)), key(fixed=("c[0]=0.3",)), key(fixed=("c[1]=0.3",)),
        key(fixed=("m=0.3",)), key(trials=experiment().trials[:1]), key(replace(STEPS, seed=1)),
        key(replace(STEPS, walkers=40)),
    ]  # fmt: skip
    assert len(set(keys)) == len(keys)
    assert keys[0] == key()


def test_a_proposals_density_is_that_of_a_t_mixture():
    """Three kernels in two dimensions."""
    random = np.random.default_rng(RNG)
    roots = np.array([np.linalg.cholesky(a @ a.T) for a in random.normal(size=(3, 2, 2))])
    mixture = KernelProposal(random.normal(size=(3, 2)), roots)
    points = np.random.default_rng(1).normal(scale=3.0, size=(200, 2))
    parts = [
        multivariate_t(c, r @ r.T, df=TAIL).logpdf(points)
        for c, r in zip(mixture.centres, mixture.roots, strict=True)
    ]
    difference = mixture.log_density(points) - logsumexp(parts, axis=0)
    np.testing.assert_allclose(difference, difference[0], rtol=0.0, atol=1e-10)


def banana(rng, count):
    x = rng.standard_normal(count)
    return np.column_stack([x, x**2 + 0.5 * rng.standard_normal(count)])


def banana_density(points):
    x, y = points.T
    return norm.logpdf(x) + norm.logpdf(y, x**2, 0.5)


@pytest.mark.parametrize("kind", ["normal", "draws"])
@pytest.mark.few(1)
def test_its_move_leaves_a_banana_as_it_is(kind):
    """Metropolis-Hastings with a proposal that is off centre gives the banana's moments."""
    if kind == "normal":
        proposal = from_normal(NormalApproximation(np.array([0.5, 2.0]), np.diag([2.0, 9.0])))
    else:
        proposal = from_draws(banana(np.random.default_rng(2), 1000) + np.array([0.3, 0.4]))
    sampler = emcee.EnsembleSampler(
        16, 2, banana_density, moves=emcee.moves.MHMove(proposal.move), vectorize=True
    )
    state = emcee.State(
        banana(np.random.default_rng(3), 16),
        random_state=np.random.RandomState(RNG).get_state(),
    )
    sampler.run_mcmc(state, 1500)
    x, y = np.moveaxis(sampler.get_chain(), -1, 0)
    statistics = np.stack([x, x**2, y, (y - 1.0) ** 2, x * y, x < 1.0, y < 0.0], axis=-1)
    exact = [0.0, 1.0, 1.0, 2.25, 0.0, norm.cdf(1.0), _share_below_zero()]
    ess = diagnose_chain(np.swapaxes(statistics, 0, 1)).ess_bulk
    error = statistics.std(axis=(0, 1)) / np.sqrt(ess)
    assert np.all(np.abs(statistics.mean(axis=(0, 1)) - exact) < 4.5 * error)


def _share_below_zero():
    """P(y < 0) of the banana, by quadrature."""
    x = np.linspace(-8.0, 8.0, 20_001)
    return np.trapezoid(norm.pdf(x) * norm.cdf(0.0, x**2, 0.5), x)


def test_autocorrelation_of_a_known_process_and_of_a_walker_that_never_moves():
    """x' = 0.9 x + noise has time (1 + 0.9)/(1 - 0.9) = 19."""
    noise = np.random.default_rng(RNG).standard_normal((20_000, 8))
    x = lfilter([1.0], [1.0, -0.9], noise, axis=0)
    assert autocorrelation_time(x[..., None]) == pytest.approx(19.0, rel=0.1)
    x[:, 2] = x[0, 2]
    assert autocorrelation_time(x[..., None]) == np.inf


def test_chains_that_disagree_are_told_and_what_does_not_vary_has_no_diagnostics():
    good = np.random.default_rng(RNG).standard_normal((4, 500, 2))
    good[..., 1] = 3.0
    found = diagnose_chain(good)
    assert found.troubles == []
    assert np.isnan([found.r_hat[1], found.ess_bulk[1]]).all()
    apart = good + np.arange(4)[:, None, None]
    assert any("R-hat" in trouble for trouble in diagnose_chain(apart).troubles)
    few = diagnose_chain(good[:, :40]).troubles
    assert any("effective samples" in trouble for trouble in few)


def test_the_highest_density_interval_is_the_shortest():
    draws = np.random.default_rng(RNG).exponential(size=(4, 50_000))
    low, high = highest_density(draws)
    assert low == pytest.approx(0.0, abs=1e-3)
    assert high == pytest.approx(-np.log(0.1), rel=0.02)
