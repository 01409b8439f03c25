"""Define options of commands that fit nothing, and groups of options, without JAX."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Annotated

import typer

from qlvbayes.io.data import Measurements, Pad

Pads = Annotated[str, typer.Option(help="Only these pads, as 'B,C'.")]
KeepAllReadings = Annotated[
    bool,
    typer.Option(
        "--keep-all-readings",
        help="Keep readings that their neighbours and the other channel contradict: lost ones, "
        "spikes, a stuck or clipped channel. Default: they are left out and named.",
    ),
]


def _use_style(context: typer.Context, file: Path | None) -> Path | None:
    """Draw all figures of the command in the user's own style."""
    if file is not None:
        # imported here, so that commands do not wait for matplotlib
        from qlvbayes.plots.style import using

        context.with_resource(using(file))
    return file


Style = Annotated[
    Path | None,
    typer.Option(
        callback=_use_style,
        help="A Matplotlib style file (.mplstyle) for the figures, over the package's own.",
        show_default=False,
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON.")]


def split_names(text: str) -> list[str]:
    """Return the names in ``A, B`` as a list."""
    return [name.strip() for name in text.split(",") if name.strip()]


def among(text: str, known: Collection[str]) -> list[str]:
    """Return the names in ``A, B`` as a list; a known name may contain commas itself."""
    parts, names = text.split(","), []
    while parts:
        ends = range(len(parts), 1, -1)
        end = next((k for k in ends if ",".join(parts[:k]).strip() in known), 1)
        names.append(",".join(parts[:end]).strip())
        parts = parts[end:]
    return [name for name in names if name]


def chosen_pads(study: Measurements, names: str) -> list[Pad]:
    """Return the named pads, or all; raise InputError on an unknown name."""
    known = [pad.name for pad in study.pads]
    return [study.pad(name) for name in among(names, known)] or list(study.pads)
