"""Measurements that come with the package: in ``data`` of the repository or of an installed one."""

from __future__ import annotations

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parents[1]


def bundled(name: str) -> Path:
    """Return the path of ``name`` (``hidden.csv``), without a file where it was not installed."""
    installed = _PACKAGE / "data" / name
    return installed if installed.is_file() else _PACKAGE.parent / "data" / name
