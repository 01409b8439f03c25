"""Read posteriors from ArviZ files, write them, and record how results were made."""

from __future__ import annotations

import json
import platform
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import xarray
from msgspec import field, to_builtins

from qlvbayes.io.checks import InputError
from qlvbayes.io.data import Measurements
from qlvbayes.io.files import Part, Result, folder_fault, write_whole
from qlvbayes.io.units import PAD, UnitSystem
from qlvbayes.model.choices import Choices
from qlvbayes.model.drawn import (
    check_draws,
    completed,
    flat_names,
    infer_choices,
    pad_name,
    stated_units,
)
from qlvbayes.model.noise import NOISES, neutral_names
from qlvbayes.motion.facts import Covered

SCHEMA = 1  # version of the attributes of a file
_LIBRARIES = (
    "qlvbayes", "jax", "jaxlib", "equinox", "emcee", "numpy", "scipy", "arviz", "xarray", "pandas",
    "matplotlib",
)  # fmt: skip
_LARGEST = 2**31  # bytes of all arrays together: a fit of long records takes some 100 MB


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
        if here and int(tree.attrs.get("schema", SCHEMA)) > SCHEMA:
            newer = f"schema {tree.attrs['schema']}, known is {SCHEMA}"
            remedy = "update qlvbayes, or run qlvbayes fit again"
            what = f"written by a newer version of qlvbayes ({newer})"
            raise InputError(what, file=path, remedy=remedy)
        saved = _ours(tree, posterior) if here else _from_elsewhere(posterior, tree.attrs, path)
    except (OSError, KeyError, ValueError, RuntimeError, TypeError) as error:
        what = f"not a results file of qlvbayes ({type(error).__name__})"
        raise InputError(what, file=path, remedy="run qlvbayes fit again") from error
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
    if missing := {"pad", "method", "source", "sha256", "all_tests"} - attrs.keys():
        raise KeyError(*missing)
    choices = Choices.from_dict(json.loads(attrs["choices"]))
    curves = _with_noise(choices, tree["curve"].to_dataset()) if "curve" in tree else None
    return Saved(
        **_stated(attrs, _with_noise(choices, posterior), pad="", method=""),
        choices=choices,
        fitted=tuple(json.loads(attrs["fitted_tests"])),
        units=stated_units(attrs.get("displacement_unit"), attrs.get("force_unit"), {}),
        covered=Covered(**json.loads(coverage)) if coverage else None,
        converged=bool(attrs.get("converged", True)),
        curves=None if curves is None else np.stack(list(curves.values()), axis=-1),
    )


def _stated(attrs: dict, draws: dict[str, np.ndarray], *, pad: str, method: str) -> dict[str, Any]:
    """Return what draws (chain, draw) by name and the attributes of any file say, by field."""
    return {
        "pad": str(attrs.get("pad", pad)),
        "names": tuple(draws),
        "constants": np.stack(list(draws.values()), axis=-1),
        "method": str(attrs.get("method", method)),
        "source": str(attrs.get("source", "")),
        "sha256": str(attrs.get("sha256", "")),
        "all_tests": bool(attrs.get("all_tests", False)),
        "fluid": str(attrs["fluid"]) if attrs.get("fluid") else None,
    }


def _with_noise(choices: Choices, posterior: xarray.Dataset) -> dict[str, np.ndarray]:
    """Return draws (chain, draw) by name; older results may lack the discrepancy's constants."""
    draws = dict(zip(*_flattened(posterior), strict=True))
    for name, value in neutral_names(NOISES[choices.noise]).items():
        draws.setdefault(name, np.full_like(next(iter(draws.values())), value))
    return draws


def _from_elsewhere(posterior: xarray.Dataset, attrs: dict, path: Path) -> Saved:
    """Return the contents of another program's posterior; attributes of the same names are read."""
    if not {"chain", "draw"} <= set(posterior.sizes):
        what = "not a results file: its posterior has no dimensions chain and draw"
        remedy = "write it with arviz, or run qlvbayes fit"
        raise InputError(what, file=path, remedy=remedy)
    by_name = {str(key): str(v.attrs.get("units", "")) for key, v in posterior.data_vars.items()}
    units = stated_units(attrs.get("displacement_unit"), attrs.get("force_unit"), by_name)
    columns = dict(zip(*_flattened(posterior), strict=True))
    try:
        bonded = bool(attrs.get("bonded", units.bonded_default))
        own = attrs.get("effects_file")
        choices = infer_choices(columns, bonded=bonded, effects_file=own)
        draws = completed(choices, columns)
        check_draws(choices, draws)
    except InputError as error:
        raise InputError(str(error), file=path) from error
    method = attrs.get("inference_library", "elsewhere")
    stated = _stated(attrs, draws, pad=pad_name(path), method=method)
    return Saved(**stated, choices=choices, fitted=(), units=units)


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


class Run(Part, frozen=True):
    """A command: its data with their digest, its seed, the model's choices, and versions."""

    command: str
    source: str
    sha256: str
    seed: int
    # as `Choices.as_dict` gives them, because a file of laws or effects may have vanished since
    choices: dict[str, Any]
    versions: dict[str, str]
    # further options of the step, ``sampler`` and ``thresholds`` among them
    settings: dict[str, Any] = field(default_factory=dict)


class RunLog(Result, frozen=True, kw_only=True):
    """The commands by which a folder of results was made, by step: ``run.json``."""

    runs: dict[str, Run]


def record_run(
    out: Path,
    step: str,
    command: str,
    study: Measurements,
    choices: Choices,
    seed: int,
    settings: Mapping[str, object] | None = None,
) -> None:
    """Record in ``out/run.json`` which command made a step; ``study`` replaces all others."""
    path = out / "run.json"
    runs: dict[str, Run] = {}
    if step != "study":
        with suppress(OSError, InputError):  # there is none yet, or it is another program's
            runs = RunLog.read(path).runs
    options, chosen = to_builtins(dict(settings or {})), choices.as_dict()
    versions = {"python": platform.python_version()}
    for name in _LIBRARIES:
        with suppress(PackageNotFoundError):
            versions[name] = version(name)
    runs[step] = Run(command, study.source, study.sha256, seed, chosen, versions, options)
    RunLog(runs=runs).write(path)
