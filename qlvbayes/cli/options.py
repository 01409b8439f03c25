"""Options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from qlvbayes.data import Pad, Study
from qlvbayes.defaults import LAWS

Out = Annotated[Path, typer.Option("-o", "--output", help="Folder for the results.")]
Pads = Annotated[str, typer.Option(help="Only these pads, as 'B,C'.")]
Elastic = Annotated[str, typer.Option(help=f"Elastic law, one of {', '.join(LAWS)}.")]
Modes = Annotated[int, typer.Option(min=1, max=6, help="Relaxation modes.")]
Bonded = Annotated[
    bool | None,
    typer.Option(
        "--bonded/--loose",
        help="Whether the specimen is fixed to the platen and can pull. Default: loose for "
        "displacement and force, bonded for strain and stress.",
    ),
]


def split_names(text: str) -> list[str]:
    """``A, B`` as a list."""
    return [name.strip() for name in text.split(",") if name.strip()]


def chosen_pads(study: Study, names: str) -> list[Pad]:
    """The named pads, or all; InputError on an unknown name."""
    return [study.pad(name) for name in split_names(names)] or list(study.pads)
