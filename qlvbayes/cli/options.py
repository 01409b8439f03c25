"""Options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from qlvbayes.checks import InputError
from qlvbayes.choices import Choices
from qlvbayes.data import Pad, Study
from qlvbayes.defaults import LAWS, NOISES
from qlvbayes.diagnosis.settings import Settings
from qlvbayes.effects.catalogue import find

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

Add = Annotated[
    list[str] | None,
    typer.Option(help="An effect to put into the model, as 'viscous_drag'; repeatable."),
]
EffectsFile = Annotated[
    Path | None, typer.Option(help="A Python file with effects of your own.", show_default=False)
]
Rested = Annotated[
    bool,
    typer.Option(
        "--rested",
        help="Take every test to begin with a pad at rest: carry nothing over from the one before.",
    ),
]
Noise = Annotated[str, typer.Option(help=f"One of {', '.join(NOISES)}.")]
Prior = Annotated[
    list[str] | None, typer.Option(help="A prior, as 'v[1]=lognormal(1.8,0.5)'; repeatable.")
]
Fix = Annotated[
    list[str] | None, typer.Option(help="A fixed constant, as 'v[2]=0.14'; repeatable.")
]
References = Annotated[
    Path | None,
    typer.Option(
        help="Values to show beside the constants: a CSV file pad,parameter,value,unit. "
        "Default: paper_table1.csv beside FILE, if it is there.",
        show_default=False,
    ),
]


def _use_style(context: typer.Context, file: Path | None) -> Path | None:
    """Draw everything that the command draws in the user's own look."""
    if file is not None:
        # here, so that commands do not wait for matplotlib
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
Tolerance = Annotated[
    str,
    typer.Option(
        help="Share of the peak force below which structure does not matter, as '1%' or '0.01'."
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON.")]
Seed = Annotated[int, typer.Option(min=0, help="Makes a run repeat.")]


def model_choices(
    study: Study,
    elastic: str,
    modes: int,
    noise: str,
    bonded: bool | None,
    prior: list[str] | None,
    fix: list[str] | None,
    add: list[str] | None,
    effects_file: Path | None,
    rested: bool,
) -> Choices:
    """The model's description from the options that every command shares."""
    choices = Choices(
        law=elastic,
        modes=modes,
        noise=noise,
        priors=tuple(prior or ()),
        fixed=tuple(fix or ()),
        bonded=study.units.bonded_default if bonded is None else bonded,
        effects=tuple(add or ()),
        effects_file=None if effects_file is None else str(effects_file.resolve()),
        rested=rested,
    )
    for name in choices.effects:
        find(name, choices.kinds)
    return choices


def share_of(text: str) -> float:
    """``1%`` or ``0.01`` as a share; InputError where it is none."""
    number, percent, rest = text.strip().partition("%")
    try:
        return float(number) / (100.0 if percent and not rest else 1.0)
    except ValueError:
        raise InputError(f"no share {text!r}", remedy="write it as 1% or 0.01") from None


def thresholds(tolerance: str) -> Settings:
    """How sure the diagnosis must be, and what is too small to matter."""
    return Settings(tolerance=share_of(tolerance))


def split_names(text: str) -> list[str]:
    """``A, B`` as a list."""
    return [name.strip() for name in text.split(",") if name.strip()]


def chosen_pads(study: Study, names: str) -> list[Pad]:
    """The named pads, or all; InputError on an unknown name."""
    return [study.pad(name) for name in split_names(names)] or list(study.pads)
