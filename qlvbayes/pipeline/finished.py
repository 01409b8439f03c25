"""Record which steps of which pads are finished, so that an interrupted run does not repeat them.

The records are small files in ``OUT/.finished``: ``<step>/<pad>.json`` has the digest of what the
step was run with and those of the files that it left, ``failed/<name>.json`` why a pad, or a file
that could not be read, has no results.
"""

from __future__ import annotations

import hashlib
import json
from contextlib import suppress
from pathlib import Path
from typing import Any

from qlvbayes.io.files import write_json
from qlvbayes.parallel.faults import Fault

FINISHED = ".finished"
FITTED = ("io", "priors", "laws", "effects", "motion", "model", "inference", "fitting")
"""Folders of the package that the numbers of a fit depend on."""
_FAILED = "failed"


def is_finished(out: Path, step: str, pad: str, key: str, folder: Path) -> bool:
    """Return whether a step was run with the same inputs and all files that it left are there."""
    try:
        record = json.loads(_file(out, step, pad).read_bytes())
        files: dict[str, str] = record["files"]
        same = record["key"] == key
    except (OSError, ValueError, KeyError, TypeError):
        return False
    return same and all(digest_of(folder / name) == sha for name, sha in files.items())


def record_finished(out: Path, step: str, pad: str, key: str, files: dict[str, str]) -> Path:
    """Record that a step is finished, with the digests of the files that it wrote by name."""
    return _write(_file(out, step, pad), {"key": key, "files": files})


def record_fault(out: Path, name: str, fault: Fault) -> None:
    """Record why a pad, or a file that could not be read, has no results."""
    record = {"fault": fault.text, "mendable": fault.mendable, "of": fault.of}
    _write(_file(out, _FAILED, name), record)


def forget_fault(out: Path, name: str) -> None:
    """Delete the fault of an earlier run."""
    with suppress(OSError):
        _file(out, _FAILED, name).unlink()


def faults_in(out: Path) -> list[Fault]:
    """Return the faults that are recorded in a folder and were not mended since."""
    files = sorted((out / FINISHED / _FAILED).glob("*.json"))
    records = [json.loads(file.read_bytes()) for file in files]
    return [Fault(one["fault"], one["mendable"], one["of"]) for one in records]


def digest_of(path: Path) -> str:
    """Return the SHA-256 of a file's content, or an empty text where there is no such file."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return ""


def _write(file: Path, content: dict[str, Any]) -> Path:
    file.parent.mkdir(parents=True, exist_ok=True)
    write_json(file, content)
    return file


def _file(out: Path, step: str, name: str) -> Path:
    return out / FINISHED / step / f"{name}.json"
