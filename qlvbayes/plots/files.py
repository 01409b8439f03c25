"""Figures on disk: whole or not at all, the same bytes for the same figure."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from qlvbayes.plots.style import style

_DPI = 200
# Neither date nor program, so that a run repeated gives the same file.
_METADATA: dict[str, dict[str, Any]] = {
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
    "png": {"Software": None},
}


def save_figure(figure: Figure, path: Path) -> Path:
    """Write ``path``.pdf (fonts embedded) and ``path``.png (200 dpi); return the latter.

    Each goes to a temporary name that is then renamed. Raises OSError where nothing can be written.
    """
    for suffix in _METADATA:
        _write(figure, path, suffix)
    return path.with_name(f"{path.name}.png")


def _write(figure: Figure, path: Path, suffix: str) -> None:
    part = path.with_name(f"{path.name}.{suffix}.part")
    try:
        with style():
            figure.savefig(part, format=suffix, dpi=_DPI, metadata=_METADATA[suffix])
        os.replace(part, path.with_name(f"{path.name}.{suffix}"))
    finally:
        part.unlink(missing_ok=True)
