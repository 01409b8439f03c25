"""Posteriors about the paper's constants, and as other programs write them."""

import arviz_base
import numpy as np

from qlvbayes.fitting.marginal_likelihood import discrepancy_of, floor_likelihood, white_likelihood
from qlvbayes.fitting.optimum import find_start, predictor_of
from qlvbayes.fitting.posterior import Posterior
from qlvbayes.model.choices import Choices
from qlvbayes.simulate import TABLE_1

PLACES = {"depth": 1.0, "rates": [1.0], "frequencies": [0.3]}
WIDTHS = {"m": 0.01, "b": 0.02, "c[1]": 0.01, "c[2]": 0.05, "v[1]": 0.02, "v[2]": 0.1}
ORDER = ["m", "b", "c[0]", "c[1]", "c[2]", "v[1]", "v[2]"]


def table_1(pad):
    names, pad = ("m", "b", "c[1]", "c[2]", "v[1]", "v[2]"), TABLE_1[pad]
    return dict(zip(names, (pad.m, pad.b, *pad.c[1:], *pad.v), strict=True))


def posterior(truth, rng, widths=WIDTHS, size=300, *, centred=False):
    """Log-normal draws as a right inference would give, whose centres miss the truth as well."""
    off = 0.0 if centred else 1.0
    draws = {
        name: value
        * np.exp(widths[name] * (off * rng.standard_normal() + rng.standard_normal(size)))
        for name, value in truth.items()
    }
    draws["c[0]"] = 1.0 - draws["c[1]"] - draws["c[2]"]
    return {name: draws[name] for name in ORDER}


CHAINS = (4, 100)


def drawn(pad="B", seed=0, noise=("white", "ou", "tau")):
    """{name: (chains, draws)} about the constants of a pad, as another program would make them."""
    rng = np.random.default_rng(seed)
    found = {k: x.reshape(CHAINS) for k, x in posterior(table_1(pad), rng, size=400).items()}
    sizes = {"white": 0.006, "ou": 0.008, "tau": 0.5}
    return found | {
        f"noise.{k}": sizes[k] * np.exp(0.05 * rng.standard_normal(CHAINS)) for k in noise
    }


def vectors(flat):
    """The same with c and v as vectors, their coordinates left to ArviZ."""
    found = {k: x for k, x in flat.items() if "[" not in k}
    for key in "cv":
        if members := [x for k, x in flat.items() if k.startswith(f"{key}[")]:
            found[key] = np.stack(members, axis=-1)
    return found


def written(folder, variables, attrs=(), **options):
    folder.mkdir(parents=True, exist_ok=True)
    tree = arviz_base.from_dict({"posterior": variables}, **options)
    tree.attrs.update(dict(attrs))
    path = folder / "posterior.nc"
    tree.to_netcdf(path, engine="h5netcdf")
    return path


def build_posterior(experiment, choices, trials):
    """Return the posterior of some trials, without looking for its mode; white noise is fixed."""
    model = predictor_of(experiment, choices, trials)
    noise, blocks = model.noise, model.record.blocks
    if choices.noise == "white":
        likelihood = white_likelihood(noise, blocks, experiment.scales.noise)
    else:
        discrepancy = discrepancy_of(experiment, trials, blocks, noise)
        likelihood = floor_likelihood(experiment, noise, discrepancy)
    return Posterior(model.space, model.hypothesis, noise, likelihood)


def from_truth(constants, experiment, seed=0):
    """Return the distance of the truth from the posterior's mean about its top, in sds."""
    start = find_start(experiment, Choices(), experiment.trials, seed)
    theta = start.normal.draw(2000, np.random.default_rng(seed))
    drawn, order = start.posterior.parameters.constants(theta), start.posterior.names
    truth = {"m": constants.m, "b": constants.b}
    truth |= {f"c[{k}]": x for k, x in enumerate(constants.c)}
    truth |= {f"v[{k}]": x for k, x in enumerate(constants.v, start=1)}
    columns = {name: drawn[:, order.index(name)] for name in truth}
    return {k: (x - columns[k].mean()) / columns[k].std() for k, x in truth.items()}
