"""Samplers and evidences next to those of other packages, each written as its users would.

The 20 mm/s test of pad B of data/pads.csv, the plain model, white and correlated noise: the same
reduced record, priors and start for all. Each runs in a process of its own with nothing compiled,
twice: the first time with what it has to compile, the second without. Effective samples are those
of the worst constant (bulk, as ArviZ counts them), over all the time from the start to the last
draw, burn-in and warm-up included. The other packages are looked for in $PYTHONPATH:

    pip install --target DIR --no-deps pints==0.6.0 cma tabulate numpyro multipledispatch tqdm \\
        lmfit asteval uncertainties dill dynesty nautilus-sampler scikit-learn joblib cloudpickle \\
        narwhals nutpie pyarrow arro3-core zarr obstore
    PYTHONPATH=DIR python benchmarks/others.py            # prints the section; --short tries it
"""

import argparse
import json
import sys
import tempfile
import time
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import emcee
import jax
import jax.numpy as jnp
import numpy as np
from rivals import NumpyPosterior
from scipy.stats import norm
from timing import in_new_process

from qlvbayes import Choices, Settings, read_study
from qlvbayes.fitting import compiled
from qlvbayes.fitting.diagnostics import diagnose_chain
from qlvbayes.fitting.ensemble import sample
from qlvbayes.fitting.fit import build_posterior
from qlvbayes.fitting.optimum import starting_point
from qlvbayes.inference.nested_sampling import nested_evidence
from qlvbayes.motion.experiment import prepare
from qlvbayes.plots.style import DOUBLE, canvas, colours, style

ROOT = Path(__file__).resolve().parents[1]


class Problem:
    """The posterior, the same one in plain numpy, and draws about its mode to start from.

    share: of the length of each run, below 1 to try the script.
    """

    def __init__(self, share=1.0, seed=0):
        experiment = prepare(read_study(ROOT / "data" / "pads.csv").pad("B"))
        self.scales, self.share, self.seed = experiment.scales, share, seed
        choices = Choices(noise="correlated")
        self.posterior = build_posterior(experiment, choices, experiment.with_role("fit"))
        rng = np.random.default_rng(seed)
        self.optimum = starting_point(self.posterior, experiment.floor, rng)
        self.starts = self.optimum.normal.draw(64, rng)
        self.plain = NumpyPosterior(self.posterior.record, experiment.scales)

    def steps(self, count):
        return max(60, int(self.share * count))

    def effective(self, draws):
        """Effective samples of the worst constant, of draws (chains, steps, D)."""
        shape = draws.shape
        constants = compiled.in_batches(
            compiled.constants, self.posterior, draws.reshape(-1, shape[-1]), size=4096
        )
        free = constants.reshape(*shape[:2], -1)
        return float(np.nanmin(diagnose_chain(free).ess_bulk))


_WARM, _KEPT = 300, 500  # steps of each of four chains of NUTS


def ours(p):
    chain = sample(p.posterior, p.optimum.normal, Settings(seed=p.seed))
    return np.swapaxes(chain.theta, 0, 1)


def plain_emcee(p):
    sampler = emcee.EnsembleSampler(32, p.starts.shape[1], p.plain)
    sampler.random_state = np.random.RandomState(p.seed).get_state()
    sampler.run_mcmc(p.starts[:32], p.steps(500))
    return np.swapaxes(sampler.get_chain(discard=p.steps(500) // 5), 0, 1)


def pints_haario(p):
    import pints

    class Density(pints.LogPDF):
        def n_parameters(self):
            return p.starts.shape[1]

        def __call__(self, theta):
            return float(p.plain(np.asarray(theta)))

    steps = p.steps(6000)
    controller = pints.MCMCController(
        Density(), 4, list(p.starts[:4]), method=pints.HaarioBardenetACMC
    )
    controller.set_max_iterations(steps)
    controller.set_log_to_screen(False)
    return np.asarray(controller.run())[:, steps // 2 :]


def numpyro_nuts(p):
    from numpyro.infer import MCMC, NUTS

    nuts = NUTS(potential_fn=lambda theta: -p.posterior.log_density(theta))
    warm, kept = p.steps(_WARM), p.steps(_KEPT)
    mcmc = MCMC(nuts, num_warmup=warm, num_samples=kept, num_chains=4, progress_bar=False,
                chain_method="vectorized")  # fmt: skip
    mcmc.run(jax.random.key(p.seed), init_params=jnp.asarray(p.starts[:4]))
    return np.asarray(mcmc.get_samples(group_by_chain=True))


def blackjax_nuts(p):
    import blackjax

    def density(theta):
        return p.posterior.log_density(theta)

    warm, kept = p.steps(_WARM), p.steps(_KEPT)

    @jax.jit
    def chain(key, start):
        first, second = jax.random.split(key)
        adaptation = blackjax.window_adaptation(blackjax.nuts, density)
        (state, parameters), _ = adaptation.run(first, start, num_steps=warm)
        step = blackjax.nuts(density, **parameters).step

        def one(state, key):
            state, _ = step(key, state)
            return state, state.position

        return jax.lax.scan(one, state, jax.random.split(second, kept))[1]

    keys = jax.random.split(jax.random.key(p.seed), 4)
    # one after the other: side by side each step would take as long as the longest of four
    return np.asarray([chain(key, start) for key, start in zip(keys, p.starts[:4], strict=True)])


def nutpie_nuts(p):
    import nutpie
    from nutpie.compiled_pyfunc import from_pyfunc

    density = jax.jit(jax.value_and_grad(p.posterior.log_density))
    size = p.starts.shape[1]

    def log_density(theta):
        value, slope = density(theta)
        return float(value), np.asarray(slope)

    model = from_pyfunc(
        size, lambda: log_density, lambda *_: lambda theta: {"theta": theta},
        [np.dtype(float)], [(size,)], ["theta"],
        make_initial_point_fn=lambda seed: p.starts[seed % len(p.starts)],
    )  # fmt: skip
    trace = nutpie.sample(model, draws=p.steps(_KEPT), tune=p.steps(_WARM), chains=4, cores=2,
                          seed=p.seed, progress_bar=False)  # fmt: skip
    return np.asarray(trace.posterior["theta"])


SAMPLERS = {
    "qlvbayes": ours,
    "numpy + emcee": plain_emcee,
    "PINTS, adaptive covariance, numpy": pints_haario,
    "numpyro NUTS on qlvbayes' density": numpyro_nuts,
    "blackjax NUTS on qlvbayes' density": blackjax_nuts,
    "nutpie NUTS on qlvbayes' density": nutpie_nuts,
}


def least_squares(p):
    """Time (s) of lmfit's least squares and its sds over the posterior's, the smallest and largest.

    White noise alone, as it is done: the correlation of the noise is not part of it.
    """
    import lmfit

    plain = p.plain
    names = ("log_m", "log_b", "break1", "break2", "log_v1", "log_gap")
    parameters = lmfit.Parameters()
    for name, value in zip(names, p.optimum.theta, strict=False):
        parameters.add(name, value=float(value))

    def residuals(values):
        theta = np.array([values[name].value for name in names])
        m, b = np.exp(theta[:2])
        share, rest = 1.0 / (1.0 + np.exp(-(theta[2:4] - np.log([2.0, 1.0]))))
        c = np.array([share, (1 - share) * rest, (1 - share) * (1 - rest)])
        v = np.exp(np.array([theta[4], theta[4] - np.exp(theta[5])]))
        return np.sqrt(plain.count) * (plain.force - plain.predicted(m, b, c, v))

    began = time.perf_counter()
    found = lmfit.minimize(residuals, parameters)
    taken = time.perf_counter() - began
    sds = np.array([found.params[name].stderr or np.nan for name in names])
    ratios = sds / np.sqrt(np.diag(p.optimum.normal.covariance))[: len(names)]
    return taken, float(np.nanmin(ratios)), float(np.nanmax(ratios))


def from_cube(scales, u):
    """Theta (D,) of a point of the unit cube, for nested samplers: the priors' quantiles.

    The rates, alike and in falling order, are order statistics.
    """
    u = np.clip(u, 1e-12, 1.0 - 1e-12)
    rate = -0.5 * np.log(scales.shortest * scales.longest)
    width = np.log(scales.longest / scales.shortest) / 4.0
    above = u[4] ** 0.5
    fast, slow = (rate + width * norm.ppf(x) for x in (above, above * u[5]))
    first, second = 1.0 - (1.0 - u[2]) ** 0.5, u[3]
    return np.array([
        np.log(scales.force / scales.depth) + np.log(5.0) * norm.ppf(u[0]),
        -np.log(scales.depth) + np.log(5.0) * norm.ppf(u[1]),
        np.log(first / (1.0 - first)) + np.log(2.0),
        np.log(second / (1.0 - second)),
        fast,
        np.log(max(fast - slow, 1e-12)),
        np.log(scales.white) + np.log(1.2) * norm.ppf(u[6]),
        np.log(3.0 * np.hypot(scales.white, scales.ou) * norm.ppf(0.5 + 0.5 * u[7])),
        np.log(scales.tau) + np.log(3.0) * norm.ppf(u[8]),
    ])  # fmt: skip


likelihoods = jax.jit(jax.vmap(lambda posterior, theta: posterior.log_likelihood(theta), (None, 0)))


def likelihood_of(p):
    """The log likelihood of thetas (n, D), one by one or padded to one compiled size."""

    def of(thetas):
        count, size = len(thetas), 64 if len(thetas) > 1 else 1
        found = []
        for k in range(0, count, size):
            part = thetas[k : k + size]
            full = np.concatenate([part, np.repeat(part[:1], size - len(part), axis=0)])
            found.append(np.asarray(likelihoods(p.posterior, full))[: len(part)])
        return np.nan_to_num(np.concatenate(found), nan=-1e100, neginf=-1e100)

    return of


def our_evidence(p):
    found = nested_evidence(p.posterior, p.seed, live=max(20, int(80 * p.share)))
    return found.log_evidence, found.error


def laplace(p):
    """From the mode, which is found again: it is part of the time."""
    rng = np.random.default_rng(p.seed)
    experiment = prepare(read_study(ROOT / "data" / "pads.csv").pad("B"))
    best = starting_point(p.posterior, experiment.floor, rng)
    sign, volume = np.linalg.slogdet(2.0 * np.pi * best.normal.covariance)
    return best.log_density + 0.5 * volume, float("nan") if sign <= 0 else 0.0


def nautilus_evidence(p):
    import nautilus

    likelihood = likelihood_of(p)
    sampler = nautilus.Sampler(
        lambda points: np.array([from_cube(p.scales, u) for u in np.atleast_2d(points)]),
        likelihood, n_dim=p.starts.shape[1], n_live=max(200, int(1000 * p.share)),
        vectorized=True, pass_dict=False, seed=p.seed,
    )  # fmt: skip
    sampler.run(verbose=False, n_eff=max(100, int(1000 * p.share)))
    return float(sampler.log_z), float(sampler.n_eff**-0.5)


def dynesty_evidence(p):
    import dynesty

    likelihood = likelihood_of(p)
    sampler = dynesty.NestedSampler(
        lambda theta: float(likelihood(theta[None])[0]), lambda u: from_cube(p.scales, u),
        p.starts.shape[1], nlive=max(50, int(250 * p.share)), sample="rslice",
        rstate=np.random.default_rng(p.seed),
    )  # fmt: skip
    sampler.run_nested(print_progress=False, dlogz=0.1 if p.share >= 1.0 else 5.0)
    return float(sampler.results.logz[-1]), float(sampler.results.logzerr[-1])


EVIDENCES = {
    "qlvbayes, nested (blackjax's slice sampler)": our_evidence,
    "qlvbayes, Laplace": laplace,
    "nautilus": nautilus_evidence,
    "dynesty, random slices": dynesty_evidence,
}


def one(name, share):
    """Run one sampler or evidence twice in this process, and print what came of it as JSON."""
    problem = Problem(share)
    run = {**SAMPLERS, **EVIDENCES}[name]
    times, answers = [], []
    for seed in (0, 1):
        problem.seed = seed
        began = time.perf_counter()
        answers.append(run(problem))
        times.append(time.perf_counter() - began)
    report = {"first_s": times[0], "again_s": times[1]}
    if name in SAMPLERS:
        report["ess"] = [problem.effective(draws) for draws in answers]
    else:
        report["log_evidence"], report["error"] = zip(*answers, strict=True)
    print(json.dumps(report))


def measured(names, share):
    """Return the report of each one; those whose package is not installed are left out."""
    found = {}
    for name in names:
        print(name, file=sys.stderr)
        with tempfile.TemporaryDirectory() as cache:
            try:
                line = in_new_process(__file__, "--one", name, "--share", share,
                                      QLVBAYES_CACHE=cache).splitlines()[-1]  # fmt: skip
            except Exception as error:
                print(f"{name}: {error}", file=sys.stderr)
                continue
        found[name] = json.loads(line)
    return found


def rates(runs):
    """Effective samples a second of each sampler, once compiled and with what it compiles."""
    return {
        name: (one["ess"][1] / one["again_s"], one["ess"][0] / one["first_s"])
        for name, one in runs.items()
    }


def draw(shown, path):
    """Bars of the effective samples a second of each sampler, as `rates` gives them."""
    with style():
        figure = canvas(DOUBLE, 20.0 + 11.0 * len(shown))
        axes = figure.subplots()
        rows = np.arange(len(shown))
        looks = [("once compiled", colours()[0]), ("with what is compiled", colours()[5])]
        for k, (label, color) in enumerate(looks):
            values = [pair[k] for pair in shown.values()]
            bars = axes.barh(rows + 0.38 * (k - 0.5), values, 0.36, color=color, label=label)
            axes.bar_label(bars, [f"{value:.3g}" for value in values], padding=3)
        axes.set(xscale="log", xlabel="effective samples of the worst constant a second")
        axes.set_yticks(rows, [name.replace(" on qlvbayes' density", "") for name in shown])
        axes.invert_yaxis()
        axes.margins(x=0.12)
        axes.legend(loc="lower right")
        figure.savefig(path)


def section(share=1.0):
    """Markdown: samplers with a picture of them, least squares, evidences."""
    runs = measured(SAMPLERS, share)
    speeds = rates(runs)
    draw(speeds, ROOT / "benchmarks" / "samplers.png")
    samplers = "\n".join(
        f"| {name} | {one['ess'][1]:.0f} | {one['again_s']:.1f} | "
        f"{speeds[name][0]:.1f} | {speeds[name][1]:.1f} |"
        for name, one in runs.items()
    )
    evidences = measured(EVIDENCES, share)
    rows = "\n".join(
        f"| {name} | {one['log_evidence'][1]:.2f} | {one['error'][1]:.2f} | "
        f"{abs(one['log_evidence'][1] - one['log_evidence'][0]):.2f} | {one['first_s']:.1f} | "
        f"{one['again_s']:.1f} |"
        for name, one in evidences.items()
    )
    return f"""\
The 20 mm/s test of pad B, the plain model with white and correlated noise: the same reduced record,
priors and start for all ({_versions()}; `benchmarks/others.py`). Effective samples of the worst
constant; all time from the start to the last draw counts, burn-in and warm-up included. *With what
is compiled*: in a process that has compiled nothing before.

| sampler | effective samples | s | a second | a second, with what is compiled |
|---|---:|---:|---:|---:|
{samplers}

![Effective samples a second of each sampler](samplers.png)

{_least_squares(share)}

Log evidence of the same model, likelihood computed by qlvbayes for all; *apart* is how far two runs
with other seeds are apart, *error* what the sampler states.

| sampler | log evidence | error | apart | s, with what is compiled | s |
|---|---:|---:|---:|---:|---:|
{rows}
"""


def _least_squares(share):
    try:
        taken, low, high = least_squares(Problem(share))
    except ImportError:
        return "Least squares with lmfit: not measured, as it is not there."
    return (
        f"For scale: lmfit's least squares with its covariance takes {taken:.2f} s in numpy; "
        f"without the noise's correlation its standard errors are {low:.2f} to {high:.2f} times "
        "those of the posterior."
    )


def _versions():
    known = []
    for name in (
        "emcee",
        "pints",
        "numpyro",
        "blackjax",
        "nutpie",
        "nautilus-sampler",
        "dynesty",
        "jax",
    ):
        try:
            known.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            known.append(f"no {name}")
    return ", ".join(known)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--one", choices=[*SAMPLERS, *EVIDENCES])
    parser.add_argument("--share", type=float, default=1.0)
    parser.add_argument("--short", action="store_true", help="a twentieth of the length, to try it")
    options = parser.parse_args()
    length = 0.05 if options.short else options.share
    if options.one:
        one(options.one, length)
    else:
        print(section(length))
