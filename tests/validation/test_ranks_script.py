"""The script of simulation-based calibration: its statistics, and that mistakes change the fit."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from ranks import _LOGNORMAL, DRAWS, Kind, band, drawn, inside, p_of_uniform, passes

ROOT = Path(__file__).parents[2]


def fits_of(ranks):
    return [{"index": k, "converged": True, "ranks": {"m": int(r)}} for k, r in enumerate(ranks)]


def test_uniform_ranks_pass_and_biased_ones_fail():
    rng = np.random.default_rng(0)
    ps = [p_of_uniform(rng.integers(0, DRAWS + 1, 200)) for _ in range(400)]
    assert 0.02 < np.mean(np.array(ps) < 0.05) < 0.09  # 0.05, with a binomial sd of 0.011
    truth = rng.normal(size=200)
    posterior = rng.normal(size=(200, DRAWS))
    centred = truth[:, None] + 0.0 * posterior + rng.normal(size=(200, 1))
    assert passes(fits_of(np.sum(centred + posterior < truth[:, None], axis=1)))
    assert not passes(fits_of(np.sum(centred + 0.5 * posterior < truth[:, None], axis=1)))
    assert not passes(fits_of(np.sum(centred + 0.7 + posterior < truth[:, None], axis=1)))
    rng = np.random.default_rng(2)
    shared = rng.integers(0, DRAWS + 1, (200, 8))
    biased = np.minimum(shared + 9, DRAWS)  # a third of the ranks' sd of 29

    def fits(ranks):
        names = [f"x{k}" for k in range(ranks.shape[1])]
        return [{"ranks": dict(zip(names, map(int, row), strict=True))} for row in ranks]

    assert passes(fits(shared))
    assert not passes(fits(biased))


def test_the_truth_is_drawn_from_the_priors_and_shares_have_bands():
    rng = np.random.default_rng(1)
    pads = [drawn(rng)[0] for _ in range(2000)]
    for name, values in (("m", [p.m for p in pads]), ("v[2]", [p.v[1] for p in pads])):
        centre, spread = _LOGNORMAL[name]
        assert np.mean(np.log(values)) == pytest.approx(centre, abs=4.0 * spread / 2000**0.5)
        assert np.std(np.log(values)) == pytest.approx(spread, rel=0.07)
    assert all(p.v[0] > p.v[1] for p in pads)
    assert f"m=lognormal({_LOGNORMAL['m'][0]!r},0.4)" in Kind().choices.priors
    assert inside(range(DRAWS + 1), 0.9) == pytest.approx(0.9)
    assert inside(range(DRAWS + 1), 0.5) == pytest.approx(0.5)
    low, high = band(100, 0.9)
    assert 0.8 < low < 0.85
    assert 0.95 < high < 1.0


@pytest.mark.parametrize("broken", ["jacobian", "noise"])
def test_a_mistake_is_in_the_density_that_is_sampled(broken):
    """In a process of its own: a mistake stays for good."""
    program = f"""
import sys
sys.path[:0] = [{str(ROOT / "validation")!r}, {str(ROOT / "tests")!r}]
import numpy as np, ranks
from tempfile import TemporaryDirectory
from pathlib import Path
from qlvbayes import read_study
from support.posteriors import build_posterior
from qlvbayes.motion.experiment import prepare
from qlvbayes.simulate import simulate_study, write_csv
truth, noise = ranks.drawn(np.random.default_rng(0))
with TemporaryDirectory() as folder:
    file = Path(folder) / "pad.csv"
    write_csv(file, simulate_study({{"pad": truth}}, [20.0], noise, 0, 60), ["x"])
    experiment = prepare(read_study(file).pad("pad"))
def density():
    own = build_posterior(experiment, ranks.Kind().choices, experiment.with_role("fit"))
    draws = own.space.prior_draws(own.hypothesis)
    constants, prior = own.parameters.bound(np.median(draws, axis=0)[None])
    likelihood = own.likelihood.log_likelihood(own.residuals(constants))
    return [float(prior[0]), float(likelihood[0])]
before = density()
ranks.BROKEN[{broken!r}]()
after = density()
print([float(abs(a - b)) for a, b in zip(before, after)])
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    prior, likelihood = json.loads(done.stdout)
    assert (prior > 0.1, likelihood > 0.1) == (broken == "jacobian", broken == "noise")
