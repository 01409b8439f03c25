"""Record how results were made, so that they can be made again: ``run.json``."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from msgspec import field, to_builtins

from qlvbayes.io.checks import InputError
from qlvbayes.io.data import Measurements
from qlvbayes.io.files import Part, Result
from qlvbayes.model.choices import Choices

_LIBRARIES = (
    "qlvbayes", "jax", "jaxlib", "equinox", "emcee", "numpy", "scipy", "arviz", "xarray", "pandas",
    "matplotlib",
)  # fmt: skip


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
