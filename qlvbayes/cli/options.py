"""Options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from qlvbayes.diagnosis.settings import Settings
from qlvbayes.effects.catalogue import find
from qlvbayes.io.checks import InputError
from qlvbayes.io.data import Measurements, Pad
from qlvbayes.laws.catalogue import LAWS, names
from qlvbayes.laws.relaxation.prony import MOST, Prony
from qlvbayes.model.choices import Choices
from qlvbayes.model.defaults import NOISES

Out = Annotated[Path, typer.Option("-o", "--output", help="Folder for the results.")]
Pads = Annotated[str, typer.Option(help="Only these pads, as 'B,C'.")]
Elastic = Annotated[
    str, typer.Option(help=f"Elastic law, one of {', '.join(names(LAWS.elastic))}.")
]
Relaxation = Annotated[
    str | None,
    typer.Option(
        help=f"Relaxation, one of {', '.join(names(LAWS.relaxation))}; prony:3 has 3 modes. "
        "Default: prony:2.",
        show_default=False,
    ),
]
Modes = Annotated[
    int | None,
    typer.Option(min=1, max=MOST, help="Short for --relaxation prony:MODES.", show_default=False),
]
LawsFile = Annotated[
    Path | None, typer.Option(help="A Python file with laws of your own.", show_default=False)
]
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
    study: Measurements,
    elastic: str,
    relaxation: str | None,
    modes: int | None,
    noise: str,
    bonded: bool | None,
    prior: list[str] | None,
    fix: list[str] | None,
    add: list[str] | None,
    effects_file: Path | None,
    laws_file: Path | None,
    *,
    rested: bool,
) -> Choices:
    """The model's description from the options that every command shares."""
    law, count = relaxation_of(relaxation, modes)
    choices = Choices(
        law=elastic,
        modes=count,
        relaxation=law,
        laws_file=None if laws_file is None else str(laws_file.resolve()),
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


def relaxation_of(relaxation: str | None, modes: int | None) -> tuple[str, int]:
    """Name and number of modes that ``--relaxation`` and ``--modes`` say together.

    Raises InputError where they contradict each other.
    """
    name, colon, number = (relaxation or Prony.name).partition(":")
    if not colon:
        if modes is not None and name != Prony.name:
            raise InputError(f"--modes is of a Prony series, not of {name}", remedy="leave it out")
        return name, 2 if modes is None else modes
    if name != Prony.name or not number.isdecimal() or not 1 <= int(number) <= MOST:
        known = ", ".join(names(LAWS.relaxation))
        raise InputError(
            f"no relaxation {relaxation!r}", remedy=f"use {Prony.name}:1 to :{MOST}, or {known}"
        )
    if modes not in (None, int(number)):
        raise InputError(f"--relaxation {relaxation} and --modes {modes} differ", remedy="give one")
    return name, int(number)


def split_names(text: str) -> list[str]:
    """``A, B`` as a list."""
    return [name.strip() for name in text.split(",") if name.strip()]


def chosen_pads(study: Measurements, names: str) -> list[Pad]:
    """The named pads, or all; InputError on an unknown name."""
    return [study.pad(name) for name in split_names(names)] or list(study.pads)
