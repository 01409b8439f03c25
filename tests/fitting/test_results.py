"""The results file: ArviZ's groups, units, likelihood, predictions, and the way back."""

import importlib
import json
import warnings
from dataclasses import replace

import arviz_base
import h5py
import numpy as np
import pytest
import xarray
from arviz_stats import summary as arviz_summary
from scipy.stats import multivariate_normal
from support.endtoend import fitted

from qlvbayes.fitting.fit import to_arviz
from qlvbayes.fitting.results import load, save
from qlvbayes.io.checks import InputError
from qlvbayes.model.choices import Choices
from qlvbayes.motion.reduction import clear_of_kinks

GROUPS = {
    "curve", "posterior", "posterior_predictive", "log_likelihood", "observed_data", "constant_data"
}  # fmt: skip
UNITS = {
    "m": "N/mm", "b": "1/mm", "c": "1", "v": "1/s", "noise.white": "N", "noise.ou": "N",
    "noise.tau": "s", "noise.factor": "1", "noise.remainder": "N",
}  # fmt: skip


@pytest.fixture(scope="module")
def arviz(tmp_path_factory):
    """Give ArviZ imported as its users do, with a cache of its own."""
    with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("arviz")))
        warnings.simplefilter("ignore")
        return importlib.import_module("arviz")


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("results") / "posterior.nc"
    save(as_tree(fitted()), path)
    return path


def as_tree(found):
    told = {"source": "/data/pads.csv", "sha256": "abc", "all_tests": False, "seed": 0}
    return to_arviz(found, found.summary(), **told)


@pytest.fixture(scope="module")
def tree(file):
    return xarray.load_datatree(file, engine="h5netcdf")


def test_arviz_opens_the_file(arviz, file):
    data = arviz.from_netcdf(file)
    groups = data.groups() if callable(data.groups) else data.groups
    assert {name.strip("/") for name in groups} - {""} == GROUPS


def test_the_file_says_its_chains_units_indices_and_origin_and_every_number_is_finite(tree):
    found = fitted()
    for group in ("posterior", "posterior_predictive", "log_likelihood"):
        sizes = tree[group].sizes
        assert (sizes["chain"], sizes["draw"]) == found.theta.shape[:2]
    assert tree["posterior"].sizes["chain"] == found.facts["walkers"]
    posterior = tree["posterior"]
    units = {name: variable.attrs["units"] for name, variable in posterior.data_vars.items()}
    assert units == UNITS
    assert tree["observed_data"]["force"].attrs["units"] == "N"
    assert tree["constant_data"]["first_s"].attrs["units"] == "s"
    assert tree["posterior"]["c_index"].values.tolist() == [0, 1, 2]
    assert tree["posterior"]["v_index"].values.tolist() == [1, 2]
    attrs = tree.attrs
    assert (attrs["pad"], attrs["method"], attrs["sha256"]) == ("B", "emcee", "abc")
    assert json.loads(attrs["fitted_tests"]) == ["B-20"]
    assert attrs["converged"] == 1
    assert attrs["force_unit"] == "N"
    for node in tree.subtree:
        for name, variable in node.data_vars.items():
            assert np.all(np.isfinite(variable)), (node.path, name)


def test_arviz_summary_agrees_with_ours(tree):
    ours = fitted().summary()
    free = {name: constant for name, constant in ours.parameters.items() if not constant.fixed}
    varying = sorted({name.split("[")[0] for name in free})
    table = arviz_summary(tree, var_names=varying, round_to="none")
    for name, constant in free.items():
        row = table.loc[name]
        # both from one chain, of which the file keeps a part
        assert abs(row["mean"] - constant.mean) < 0.15 * constant.sd
        assert row["sd"] == pytest.approx(constant.sd, rel=0.1)
        assert row["r_hat"] < 1.05


def test_pointwise_log_likelihood_sums_to_the_joint_one(tree):
    """The joint one is that of the draw's pair of factor and remainder."""
    found = fitted()
    floor, blocks = found.posterior.likelihood, found.posterior.record.blocks
    pointwise = tree["log_likelihood"]["force"].values
    for chain, draw in ((0, 0), (3, 11), (31, 40)):
        constants = found.followed[chain, draw]
        (left,) = found.posterior.residuals(constants[None])
        pair = np.flatnonzero((np.asarray(floor.constants)[:, -2:] == constants[-2:]).all(axis=1))
        axes, precisions = np.asarray(floor.axes), np.asarray(floor.precisions)[pair[0]]
        noise = np.linalg.inv(axes.T @ (precisions[:, None] * axes))
        normal = multivariate_normal(cov=noise, allow_singular=True)
        joint = normal.logpdf(left[np.asarray(blocks.real)])
        assert pointwise[chain, draw].sum() == pytest.approx(joint, rel=1e-8)


def test_observed_data_are_the_block_means(tree):
    """Weighted by their counts they average to the mean of all samples clear of kinks."""
    (trial,) = fitted().trials
    observed, facts = tree["observed_data"]["force"].values, tree["constant_data"]
    count = facts["samples"].values
    used = clear_of_kinks(trial.test.time, trial.trajectory, trial.phases)
    assert count.sum() == used.sum() > 0.9 * used.size
    assert np.average(observed, weights=count) == pytest.approx(trial.test.force[used].mean())
    assert np.all(facts["first_s"].values <= facts["last_s"].values)
    assert set(facts["test"].values.tolist()) == {0}


def test_posterior_predictive_covers_what_was_observed_with_the_models_noise(tree):
    draws = tree["posterior_predictive"]["force"].values
    draws = draws.reshape(-1, draws.shape[-1])
    observed = tree["observed_data"]["force"].values
    low, high = np.quantile(draws, [0.05, 0.95], axis=0)
    assert 0.8 < np.mean((observed >= low) & (observed <= high)) < 0.99
    # in units of its own sd the difference has neither a mean nor a spread of its own
    z = (observed - draws.mean(axis=0)) / draws.std(axis=0)
    assert abs(z.mean()) < 0.6
    assert 0.7 < z.std() < 1.3


def test_what_is_saved_of_least_squares_is_loaded(tmp_path):
    choices = Choices(elastic="hertz", modes=1, noise="white", priors=("m=lognormal(0,1)",))
    found = fitted(choices, method="least-squares")
    save(as_tree(found), tmp_path / "posterior.nc")
    saved = load(tmp_path / "posterior.nc")
    assert (list(saved.names), saved.choices) == (found.names, found.choices)
    np.testing.assert_array_equal(saved.constants, found.constants)
    assert (saved.pad, saved.method, saved.fitted) == ("B", "least-squares", ("B-20",))
    assert (saved.source, saved.sha256, saved.all_tests) == ("/data/pads.csv", "abc", False)
    assert [entry.name for entry in tmp_path.iterdir()] == ["posterior.nc"]


def test_arrays_carry_checksums_and_a_file_of_a_newer_version_names_the_remedy(file, tmp_path):
    with h5py.File(file) as content:
        for name in ("posterior/m", "posterior/c", "observed_data/force", "posterior/chain"):
            assert content[name].fletcher32, name
    newer = tmp_path / "posterior.nc"
    newer.write_bytes(file.read_bytes())
    with h5py.File(newer, "a") as content:
        content.attrs["schema"] = 2
    with pytest.raises(InputError, match=r"newer version of qlvbayes .*; update qlvbayes"):
        load(newer)


def test_what_is_no_results_file_is_refused(tmp_path):
    path = tmp_path / "posterior.nc"
    for content in (b"", b"x", b"\x89HDF\r\n\x1a\n" + bytes(200)):
        path.write_bytes(content)
        with pytest.raises(InputError, match="not a results file"):
            load(path)
    path.unlink()
    other = xarray.DataTree.from_dict({"posterior": xarray.Dataset({"a": ("x", np.ones(3))})})
    other.to_netcdf(path, engine="h5netcdf")
    with pytest.raises(InputError, match="not a results file"):
        load(path)


def test_a_strangers_file_takes_no_memory_and_reads_no_other_file(tmp_path):
    other, raw = tmp_path / "other.h5", tmp_path / "raw"
    with h5py.File(other, "w") as file:
        file["secret"] = np.ones((2, 3))
    raw.write_bytes(bytes(48))
    layout = h5py.VirtualLayout((2, 3), "f8")
    layout[:] = h5py.VirtualSource(str(other), "secret", (2, 3))
    large = {"shape": (10**6, 10**6), "dtype": "f8", "chunks": (1000, 1000)}
    elsewhere = {"shape": (2, 3), "dtype": "f8", "external": [(str(raw), 0, 48)]}
    for number, add in enumerate(
        (
            lambda group: group.create_dataset("b", **large),  # 1e12 numbers on no disk
            lambda group: group.__setitem__("b", h5py.ExternalLink("other.h5", "/secret")),
            lambda group: group.create_dataset("b", **elsewhere),
            lambda group: group.create_virtual_dataset("b", layout),
        )
    ):
        path = tmp_path / f"{number}.nc"
        with h5py.File(path, "w") as file:
            group = file.create_group("posterior")
            group["m"] = np.ones((2, 3))
            add(group)
        with pytest.raises(InputError, match="not a results file"):
            load(path)


def test_a_fluid_and_what_the_tests_cover_travel_and_the_same_fit_gives_the_same_numbers(
    file, tree, tmp_path
):
    saved, found = load(file), fitted()
    assert list(saved.names) == found.names
    np.testing.assert_array_equal(saved.constants, found.constants)
    assert (saved.choices, saved.fitted) == (found.choices, ("B-20",))
    assert saved.fluid is None
    assert saved.converged
    reach = saved.covered
    assert reach.depth == pytest.approx(1.6, abs=0.01)
    assert (reach.slowest, reach.tests) == (pytest.approx(0.1, rel=0.01), 6)
    assert reach.hold == pytest.approx(30.0, rel=0.01)
    oily = as_tree(replace(found, experiment=replace(found.experiment, fluid="oil")))
    for group in GROUPS:
        xarray.testing.assert_equal(tree[group].to_dataset(), oily[group].to_dataset())
    save(oily, tmp_path / "posterior.nc")
    assert load(tmp_path / "posterior.nc").fluid == "oil"


def test_the_posterior_alone_written_by_arviz_is_still_understood(arviz, file, tmp_path):
    """ArviZ reads our file; its posterior, written again without our notes, names its model."""
    ours = load(file)
    posterior = arviz.from_netcdf(file)["posterior"]
    variables = {name: x.values for name, x in posterior.data_vars.items()}
    path = tmp_path / "B" / "posterior.nc"
    path.parent.mkdir()
    save(arviz_base.from_dict({"posterior": variables}), path)
    again = load(path)
    assert again.choices == ours.choices
    assert again.covered is None
    order = [ours.names.index(name) for name in again.names]
    np.testing.assert_array_equal(again.constants, ours.constants[..., order])
