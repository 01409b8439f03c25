"""Results on disk: whole or not at all."""

from __future__ import annotations

import json
import os
from pathlib import Path

from qlvbayes.checks import InputError


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


def write_json(path: Path, content: object) -> None:
    """Write JSON whose numbers are finite or null, to a temporary name, then rename."""
    part = path.with_suffix(".part")
    try:
        part.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", encoding="utf-8")
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)
