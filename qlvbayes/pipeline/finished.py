"""Record which pads of a step are finished, so that an interrupted run does not repeat them."""

from __future__ import annotations

import hashlib
import json
from contextlib import suppress
from pathlib import Path
from typing import Any

from qlvbayes.io.files import write_json
from qlvbayes.parallel.faults import Fault

FINISHED = ".finished"
"""Folder within the folder of results, with one file for each step and pad."""


class Finished:
    """Pads that one step has finished, and those that failed, each recorded in a small file.

    out: folder of the results; step: name of the step.
    """

    def __init__(self, out: Path, step: str) -> None:
        self._folder = out / FINISHED / step

    def has(self, pad: str, key: str, folder: Path) -> bool:
        """Return whether a pad was finished from the same input and all its files are there."""
        try:
            record = json.loads(self._file(pad).read_bytes())
            files: dict[str, str] = record["files"]
            same = record["key"] == key
        except (OSError, ValueError, KeyError, TypeError):
            return False
        return same and all(digest_of(folder / name) == sha for name, sha in files.items())

    def add(self, pad: str, key: str, files: dict[str, str]) -> None:
        """Record that a pad is finished, with the digests of the files that the step wrote."""
        self._write(pad, {"key": key, "files": files})

    def fail(self, name: str, fault: Fault) -> None:
        """Record why a pad, or a file that could not be read, has no results."""
        record = {"fault": fault.text, "mendable": fault.mendable, "of": fault.of}
        self._write(name, record)

    def forget(self, name: str) -> None:
        """Delete the record of an earlier run."""
        with suppress(OSError):
            self._file(name).unlink()

    def _write(self, name: str, content: dict[str, Any]) -> None:
        self._folder.mkdir(parents=True, exist_ok=True)
        write_json(self._file(name), content)

    def _file(self, name: str) -> Path:
        return self._folder / f"{name}.json"


def faults_in(out: Path) -> list[Fault]:
    """Return the faults of all steps that are recorded in a folder and were not mended since."""
    faults = []
    for file in sorted(out.glob(f"{FINISHED}/*/*.json")):
        record = json.loads(file.read_bytes())
        if "fault" in record:
            faults.append(Fault(record["fault"], record["mendable"], record["of"]))
    return faults


def digest_of(path: Path) -> str:
    """Return the SHA-256 of a file's content, or an empty text where there is no such file."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return ""
