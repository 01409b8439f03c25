"""How results were made, so that they can be made again: ``run.json``."""

from __future__ import annotations

import json
import platform
from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from qlvbayes.choices import Choices
from qlvbayes.data import Study
from qlvbayes.diagnosis.settings import Settings as Thresholds
from qlvbayes.files import write_json

_LIBRARIES = (
    "qlvbayes",
    "jax",
    "jaxlib",
    "equinox",
    "emcee",
    "blackjax",
    "numpy",
    "scipy",
    "arviz",
    "xarray",
    "pandas",
    "matplotlib",
)


def record_run(
    out: Path,
    step: str,
    command: str,
    study: Study,
    choices: Choices,
    seed: int,
    thresholds: Thresholds | None = None,
) -> None:
    """Note in ``out/run.json`` by which command a step was made; ``study`` replaces all others.

    thresholds: of the diagnosis, by default its own.
    """
    path = out / "run.json"
    runs = {} if step == "study" else _before(path)
    runs[step] = {
        "command": command,
        "source": study.source,
        "sha256": study.sha256,
        "seed": seed,
        "choices": choices.as_dict(),
        "thresholds": asdict(thresholds or Thresholds()),
        "versions": _versions(),
    }
    write_json(path, {"schema": 1, "runs": runs})


def _before(path: Path) -> dict:
    try:
        return dict(json.loads(path.read_text(encoding="utf-8"))["runs"])
    except (OSError, ValueError, KeyError, TypeError):
        return {}  # none yet, or not ours


def _versions() -> dict[str, str]:
    """Of Python and of the libraries that the numbers depend on."""
    found = {"python": platform.python_version()}
    for name in _LIBRARIES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found
