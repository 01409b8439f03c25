"""Write a fit as an ArviZ file and read it: the only module that uses ArviZ's data structures."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path

import arviz_base
import h5py
import numpy as np
import xarray

import qlvbayes
from qlvbayes.fitting.fit import Fit
from qlvbayes.fitting.summary import FitSummary
from qlvbayes.io.checks import InputError
from qlvbayes.io.files import folder_fault, write_whole
from qlvbayes.io.units import PAD, UnitSystem
from qlvbayes.model.choices import Choices
from qlvbayes.model.elsewhere import (
    check_draws,
    completed,
    flat_names,
    infer_choices,
    pad_name,
    stated_units,
)
from qlvbayes.model.noise import NOISES, neutral_names
from qlvbayes.model.parameters import all_fields, described
from qlvbayes.motion.facts import Covered, covered

_SCHEMA = 1  # version of the attributes of a file
_LARGEST = 2**31  # bytes of all arrays together: a fit of long records takes some 100 MB
_MEMBER = re.compile(r"(.+)\[(\d+)\]")


@dataclass(frozen=True)
class Saved:
    """The contents of a results file: draws of the constants, and how they were obtained."""

    # pad, names: name of the pad, and names of the P constants
    pad: str
    names: tuple[str, ...]
    constants: np.ndarray  # draws (chains, draws, P)
    # choices, method: model, and method by which it was fitted
    choices: Choices
    method: str
    # source, sha256, fitted: file of the data, its digest, and names of the fitted tests; empty for
    # a posterior made elsewhere, where its file does not state them
    source: str
    sha256: str
    all_tests: bool  # whether all tests of the pad were used
    fitted: tuple[str, ...]
    fluid: str | None = None  # fluid of the pad, where it is known
    units: UnitSystem = PAD  # unit system of the constants
    covered: Covered | None = None  # what the tests cover
    converged: bool = True  # whether nothing spoke against the sampling
    # draws where the curve follows the data, which predict the tests; None where these are the
    # draws themselves
    curves: np.ndarray | None = None

    @property
    def draws(self) -> np.ndarray:
        """Return draws (chains*draws, P) of the constants."""
        return self.constants.reshape(-1, self.constants.shape[-1])

    @property
    def curve_draws(self) -> np.ndarray:
        """Return draws (chains*draws, P) of the constants where the curve follows the data."""
        return self.draws if self.curves is None else self.curves.reshape(self.draws.shape)


def to_arviz(
    fit: Fit, summary: FitSummary, *, source: str, sha256: str, all_tests: bool, seed: int
) -> xarray.DataTree:
    """Return a fit as a tree of posterior, predictive, log likelihood and data."""
    posterior, dims, coords = _grouped(fit.names, fit.constants)
    force = fit.experiment.units.force_name
    real = np.asarray(fit.posterior.record.blocks.real)
    shape = fit.theta.shape[:2]
    followed = fit.followed.reshape(-1, fit.followed.shape[-1])
    likelihood, predicted = fit.posterior.judged(followed, np.random.default_rng(seed))
    moved = not np.array_equal(fit.followed, fit.constants)
    curve = {"curve": _grouped(fit.names, fit.followed)[0]} if moved else {}
    facts, coords["block"] = _block_facts(fit, real), np.arange(int(real.sum()))
    dims |= {name: ["block"] for name in (force, *facts)}
    tree = arviz_base.from_dict(
        {
            "posterior": posterior,
            **curve,
            "posterior_predictive": {force: predicted.reshape(*shape, -1)},
            "log_likelihood": {force: likelihood.reshape(*shape, -1)},
            "observed_data": {force: np.asarray(fit.posterior.record.blocks.force)[real]},
            "constant_data": facts,
        },
        coords=coords,
        dims=dims,
    )
    _label(tree, fit, force)
    for node in tree.subtree:
        node.attrs.pop("created_at", None)  # the same fit gives the same file
    tree.attrs.update(_provenance(fit, summary, source, sha256, all_tests, seed))
    return tree


def _grouped(names: list[str], constants: np.ndarray) -> tuple[dict, dict, dict]:
    """Return variables (c and v as vectors), their dimensions and their coordinates."""
    members: dict[str, list[tuple[int | None, int]]] = {}
    for column, name in enumerate(names):
        match = _MEMBER.fullmatch(name)
        key, index = (match[1], int(match[2])) if match else (name, None)
        members.setdefault(key, []).append((index, column))
    variables, dims, coords = {}, {}, {}
    for key, indices_columns in members.items():
        columns = [column for _, column in indices_columns]
        if indices_columns[0][0] is None:
            variables[key] = constants[..., columns[0]]
            continue
        variables[key] = constants[..., columns]
        dims[key] = [f"{key}_index"]
        coords[f"{key}_index"] = np.array([index for index, _ in indices_columns])
    return variables, dims, coords


def _block_facts(fit: Fit, real: np.ndarray) -> dict[str, np.ndarray]:
    """Return the test, times, samples and weight of each block."""
    blocks = fit.posterior.record.blocks
    test = np.repeat(np.arange(len(real))[:, None], real.shape[1], axis=1)
    return {
        "test": test[real],
        "first_s": np.asarray(blocks.first)[real],
        "last_s": np.asarray(blocks.last)[real],
        "samples": np.asarray(blocks.count)[real],
        "weight": np.asarray(blocks.weight)[real],
    }


def _label(tree: xarray.DataTree, fit: Fit, force: str) -> None:
    """Add units to the variables."""
    for name, unit in zip(fit.names, fit.units, strict=True):
        match = _MEMBER.fullmatch(name)
        tree["posterior"][match[1] if match else name].attrs["units"] = unit
    for group in ("posterior_predictive", "observed_data"):
        tree[group][force].attrs["units"] = fit.experiment.units.force
    for name in ("first_s", "last_s"):
        tree["constant_data"][name].attrs["units"] = "s"


def _provenance(
    fit: Fit, summary: FitSummary, source: str, sha256: str, all_tests: bool, seed: int
) -> dict:
    """Return the attributes that say how the fit was made."""
    units = fit.experiment.units
    return {
        "schema": _SCHEMA,
        "pad": fit.pad,
        "method": fit.method,
        "converged": int(summary.converged),
        "choices": json.dumps(fit.choices.as_dict()),
        "priors": json.dumps(described(all_fields(fit.posterior))),
        "effects": json.dumps(list(fit.choices.effects)),
        "fitted_tests": json.dumps([trial.name for trial in fit.trials]),
        "all_tests": int(all_tests),
        "fluid": fit.experiment.fluid or "",
        "covered": json.dumps(covered(fit.experiment).as_dict()),
        "source": source,
        "sha256": sha256,
        "seed": seed,
        "displacement_unit": units.displacement,
        "force_unit": units.force,
        "qlvbayes_version": qlvbayes.__version__,
        **fit.facts,
    }


def save(tree: xarray.DataTree, path: Path) -> None:
    """Write the file completely or not at all, with checksums of its numbers."""
    checksums = {
        node.path: {name: {"fletcher32": True} for name in node.to_dataset(inherit=False).variables}
        for node in tree.subtree
    }
    write_whole(path, tree.to_netcdf(engine="h5netcdf", encoding=checksums))


def load(path: Path) -> Saved:
    """Read a results file, or a posterior made elsewhere that uses the same names of the constants.

    Parameters
    ----------
    path
        An ArviZ file (NetCDF), as ``OUT/<pad>/posterior.nc``; an InputError names what is missing.
    """
    try:
        _check_arrays(path)
        tree = xarray.load_datatree(path, engine="h5netcdf")
        posterior = tree["posterior"].to_dataset()
        here = "choices" in tree.attrs
        if here and int(tree.attrs.get("schema", _SCHEMA)) > _SCHEMA:
            raise InputError(
                f"written by a newer version of qlvbayes (schema {tree.attrs['schema']}, known is "
                f"{_SCHEMA})",
                file=path,
                remedy="update qlvbayes, or run qlvbayes fit again",
            )
        saved = _ours(tree, posterior) if here else _from_elsewhere(posterior, tree.attrs, path)
    except (OSError, KeyError, ValueError, RuntimeError, TypeError) as error:
        raise InputError(
            f"not a results file of qlvbayes ({type(error).__name__})",
            file=path,
            remedy="run qlvbayes fit again",
        ) from error
    for what, name in (("pad", saved.pad), ("fluid", saved.fluid)):
        if name is not None and (fault := folder_fault(name)) is not None:
            raise InputError(f"the {what}'s name '{name}' {fault[0]}", file=path, remedy=fault[1])
    return saved


def _check_arrays(path: Path) -> None:
    """Open a stranger's file without reading its arrays; raise ValueError where that is no use."""
    sizes = [0]

    def look(name: str, node: h5py.Dataset | h5py.Group) -> str | None:
        if not isinstance(node, h5py.Dataset):
            return None
        sizes.append(node.size * node.dtype.itemsize)
        return name if node.external or node.is_virtual else None

    def follow(name: str, link: object) -> str | None:
        return name if isinstance(link, h5py.ExternalLink) else None

    with h5py.File(path) as file:
        elsewhere = file.visititems_links(follow) or file.visititems(look)
    if elsewhere is not None:
        raise ValueError(f"{elsewhere} is in another file")
    if sum(sizes) > _LARGEST:
        raise ValueError(f"its arrays need {sum(sizes)} bytes")


def _ours(tree: xarray.DataTree, posterior: xarray.Dataset) -> Saved:
    """Return the contents of a file that this program wrote."""
    attrs, coverage = tree.attrs, tree.attrs.get("covered")
    choices = Choices.from_dict(json.loads(attrs["choices"]))
    draws = _with_noise(choices, posterior)
    curves = _with_noise(choices, tree["curve"].to_dataset()) if "curve" in tree else None
    return Saved(
        pad=str(attrs["pad"]),
        names=tuple(draws),
        constants=np.stack(list(draws.values()), axis=-1),
        choices=choices,
        method=str(attrs["method"]),
        source=str(attrs["source"]),
        sha256=str(attrs["sha256"]),
        all_tests=bool(attrs["all_tests"]),
        fitted=tuple(json.loads(attrs["fitted_tests"])),
        fluid=str(attrs["fluid"]) if attrs.get("fluid") else None,
        units=stated_units(attrs.get("displacement_unit"), attrs.get("force_unit"), {}),
        covered=Covered(**json.loads(coverage)) if coverage else None,
        converged=bool(attrs.get("converged", True)),
        curves=None if curves is None else np.stack(list(curves.values()), axis=-1),
    )


def _with_noise(choices: Choices, posterior: xarray.Dataset) -> dict[str, np.ndarray]:
    """Return draws (chain, draw) by name; older results may lack the discrepancy's constants."""
    draws = dict(zip(*_flattened(posterior), strict=True))
    for name, value in neutral_names(NOISES[choices.noise]).items():
        draws.setdefault(name, np.full_like(next(iter(draws.values())), value))
    return draws


def _from_elsewhere(posterior: xarray.Dataset, attrs: dict, path: Path) -> Saved:
    """Return the contents of another program's posterior; attributes of the same names are read."""
    if not {"chain", "draw"} <= set(posterior.sizes):
        raise InputError(
            "not a results file: its posterior has no dimensions chain and draw",
            file=path,
            remedy="write it with arviz, or run qlvbayes fit",
        )
    units = stated_units(
        attrs.get("displacement_unit"),
        attrs.get("force_unit"),
        {str(key): str(v.attrs.get("units", "")) for key, v in posterior.data_vars.items()},
    )
    columns = dict(zip(*_flattened(posterior), strict=True))
    try:
        choices = infer_choices(
            columns,
            bonded=bool(attrs.get("bonded", units.bonded_default)),
            effects_file=attrs.get("effects_file"),
        )
        draws = completed(choices, columns)
        check_draws(choices, draws)
    except InputError as error:
        raise InputError(str(error), file=path) from error
    return Saved(
        pad=str(attrs.get("pad", pad_name(path))),
        names=tuple(draws),
        constants=np.stack(list(draws.values()), axis=-1),
        choices=choices,
        method=str(attrs.get("method", attrs.get("inference_library", "elsewhere"))),
        source=str(attrs.get("source", "")),
        sha256=str(attrs.get("sha256", "")),
        all_tests=bool(attrs.get("all_tests", False)),
        fitted=(),
        fluid=str(attrs["fluid"]) if attrs.get("fluid") else None,
        units=units,
    )


def _flattened(posterior: xarray.Dataset) -> tuple[list[str], list[np.ndarray]]:
    """Return names and draws (chain, draw) of every number; vectors' members by index."""
    names, columns = [], []
    for key, variable in posterior.data_vars.items():
        values = variable.transpose("chain", "draw", ...).to_numpy()
        if values.ndim == 2:
            names.append(str(key))
            columns.append(values)
        elif values.ndim == 3:
            dim = str(variable.dims[-1])
            labels = posterior[dim].values.tolist() if dim in posterior.coords else []
            names += flat_names(str(key), labels, values.shape[-1])
            columns += list(np.moveaxis(values, -1, 0))
    return names, columns
