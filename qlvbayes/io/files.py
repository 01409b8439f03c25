"""Results on disk: whole or not at all."""

from __future__ import annotations

import json
import os
from pathlib import Path

from qlvbayes.io.checks import InputError


def results_folder(path: Path) -> Path:
    """Make a folder for results and see that it can be written; InputError if not."""
    probe = path / ".write-test"
    try:
        path.mkdir(parents=True, exist_ok=True)
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise InputError(
            f"cannot write results here ({error.strerror})",
            file=path,
            remedy="choose another folder with -o",
        ) from error
    return path


def write_whole(path: Path, content: bytes | memoryview) -> None:
    """Write to a name of its own, then rename; where that fails, an OSError names the file."""
    part = path.with_name(f"{path.name}.{os.getpid()}.part")
    try:
        part.write_bytes(content)
        os.replace(part, path)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from error
    finally:
        part.unlink(missing_ok=True)


def write_json(path: Path, content: object, *, indent: int | None = 2) -> None:
    """Write JSON whose numbers are finite or null, whole or not at all."""
    text = json.dumps(content, indent=indent, allow_nan=False) + "\n"
    write_whole(path, text.encode())
