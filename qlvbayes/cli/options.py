"""Define options that several commands share.

What their help does not need is imported where it is used: a model takes seconds to import.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from qlvbayes.io.catalogue import ELASTIC, MOST_MODES, NOISES, RELAXATION
from qlvbayes.io.checks import InputError
from qlvbayes.io.runtime import cores
from qlvbayes.io.wording import listed
from qlvbayes.parallel.engines import Engine, opened_engine
from qlvbayes.parallel.shards import Shard

if TYPE_CHECKING:
    from qlvbayes.diagnosis.settings import DiagnosisSettings
    from qlvbayes.io.data import Measurements, Pad
    from qlvbayes.model.choices import Choices
    from qlvbayes.pipeline.source import Source

PRONY = next(iter(RELAXATION))  # the only one that takes a number of modes

Pads = Annotated[str, typer.Option(help="Only these pads, as 'B,C'.")]
KeepAllReadings = Annotated[
    bool,
    typer.Option(
        "--keep-all-readings",
        help="Keep readings that their neighbours and the other channel contradict: lost ones, "
        "spikes, a stuck or clipped channel. Default: they are left out and named.",
    ),
]

Use = Annotated[
    list[str] | None,
    typer.Option(
        help="The part of a test that is used, as 'TEST:0..18mm' or 'TEST:0..12s': what lies "
        "before and behind it is left out; repeatable.",
        show_default=False,
    ),
]
LeaveOut = Annotated[
    list[str] | None,
    typer.Option(
        help="A part of a test whose force does not count while its motion does, as "
        "'TEST:30..45s', 'TEST:0..0.1mm' or 'TEST:hold 2'; repeatable.",
        show_default=False,
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


Files = Annotated[
    list[Path],
    typer.Argument(
        help="Measurements: a tidy .csv or .csv.gz file, one of a testing machine, several files, "
        "or a folder of them. Of several each pad is named after its file.",
        metavar="FILE...",
    ),
]
Fitted = Annotated[Path, typer.Argument(help="The folder that 'fit' wrote.")]
Out = Annotated[Path, typer.Option("-o", "--output", help="Folder for the results.")]
Elastic = Annotated[str, typer.Option(help=f"Elastic law, one of {', '.join(ELASTIC)}.")]
Relaxation = Annotated[
    str | None,
    typer.Option(
        help=f"Relaxation, one of {', '.join(RELAXATION)}; prony:3 has 3 modes. Default: prony:2.",
        show_default=False,
    ),
]
Modes = Annotated[
    int | None,
    typer.Option(
        min=1, max=MOST_MODES, help="Short for --relaxation prony:MODES.", show_default=False
    ),
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
        help="Take every test to begin with a pad at rest: assume no effect of the test before.",
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
        help="Values to show next to the constants: a CSV file pad,parameter,value,unit. "
        "Default: paper_table1.csv next to FILE, if it is there.",
        show_default=False,
    ),
]
Tolerance = Annotated[
    str,
    typer.Option(
        help="Share of the peak force below which structure does not matter, as '1%' or '0.01'."
    ),
]
Jobs = Annotated[
    int,
    typer.Option(
        min=0,
        help="Processes that work side by side, each at a pad of its own; 0: as many as cores. "
        "Results do not depend on it.",
    ),
]
Cluster = Annotated[
    str | None,
    typer.Option(
        help="Address of a Dask scheduler whose workers do it, as tcp://HOST:8786.",
        show_default=False,
    ),
]
ShardText = Annotated[
    str | None,
    typer.Option(
        "--shard",
        help="Do one part of many, as 3/200, or in an array of SLURM as slurm; 'gather' then "
        "makes what is made of all.",
        show_default=False,
    ),
]
Seed = Annotated[int, typer.Option(min=0, help="Makes a run repeat.")]


@dataclass(frozen=True)
class WorkOptions:
    """Options that say which workers do the work, and which part of it."""

    jobs: Jobs = 1
    cluster: Cluster = None
    shard: ShardText = None

    def engine(self) -> AbstractContextManager[Engine | None]:
        """Return the engine for a ``with`` statement, which yields None for this process."""
        return opened_engine(self.jobs or cores(), self.cluster)

    @property
    def part(self) -> Shard:
        """Part of the pads that is run; reading it raises InputError on an invalid --shard."""
        return Shard.from_text(self.shard) if self.shard else Shard()


@dataclass(frozen=True)
class ModelOptions:
    """Options that describe a model: those of every command that fits one."""

    elastic: Elastic = "exponential"
    relaxation: Relaxation = None
    modes: Modes = None
    noise: Noise = "floor"
    bonded: Bonded = None
    rested: Rested = False
    keep_all_readings: KeepAllReadings = False
    use: Use = None
    leave_out: LeaveOut = None
    prior: Prior = None
    fix: Fix = None
    add: Add = None
    effects_file: EffectsFile = None
    laws_file: LawsFile = None

    def choices(self, study: Measurements) -> Choices:
        """Return the model's description; raise InputError where an option cannot be used."""
        from qlvbayes.effects.catalogue import find
        from qlvbayes.model.choices import Choices

        law, count = relaxation_of(self.relaxation, self.modes)
        bonded = study.units.bonded_default if self.bonded is None else self.bonded
        choices = Choices(
            law=self.elastic,
            modes=count,
            relaxation=law,
            laws_file=None if self.laws_file is None else str(self.laws_file.resolve()),
            noise=self.noise,
            priors=tuple(self.prior or ()),
            fixed=tuple(self.fix or ()),
            bonded=bonded,
            effects=tuple(self.add or ()),
            effects_file=None if self.effects_file is None else str(self.effects_file.resolve()),
            rested=self.rested,
            keep_all_readings=self.keep_all_readings,
            use=tuple(self.use or ()),
            leave_out=tuple(self.leave_out or ()),
        )
        for name in choices.effects:
            find(name, choices.kinds)
        return choices

    def choices_of(self, source: Source) -> Choices:
        """Return the model's description for pads; raise InputError also on an unknown test.

        Of several files one is read at a time, so that no test can be missed before the last.
        """
        from qlvbayes.motion.pad import refuse_unknown

        choices = self.choices(source.whole)
        if source.read is not None:
            refuse_unknown(source.read.pads, choices.use, choices.leave_out)
        return choices


def share_of(text: str) -> float:
    """Return the share that ``1%`` or ``0.01`` states; raise InputError where it is none."""
    number, percent, rest = text.strip().partition("%")
    try:
        return float(number) / (100.0 if percent and not rest else 1.0)
    except ValueError:
        raise InputError(f"no share {text!r}", remedy="write it as 1% or 0.01") from None


def thresholds(tolerance: str) -> DiagnosisSettings:
    """Return the thresholds of the diagnosis with a tolerance, as ``1%``."""
    from qlvbayes.diagnosis.settings import DiagnosisSettings

    return DiagnosisSettings(tolerance=share_of(tolerance))


def relaxation_of(relaxation: str | None, modes: int | None) -> tuple[str, int]:
    """Return the name and the number of modes that ``--relaxation`` and ``--modes`` state."""
    name, colon, number = (relaxation or PRONY).partition(":")
    if not colon:
        if modes is not None and name != PRONY:
            raise InputError(f"--modes is of a Prony series, not of {name}", remedy="leave it out")
        return name, 2 if modes is None else modes
    if name != PRONY or not number.isdecimal() or not 1 <= int(number) <= MOST_MODES:
        known = ", ".join(RELAXATION)
        raise InputError(
            f"no relaxation {relaxation!r}", remedy=f"use {PRONY}:1 to :{MOST_MODES}, or {known}"
        )
    if modes not in (None, int(number)):
        raise InputError(f"--relaxation {relaxation} and --modes {modes} differ", remedy="give one")
    return name, int(number)


def known_names(names: str, known: Collection[str], folder: Path, what: str = "fit") -> list[str]:
    """Return the names in ``A, B``.

    Raise InputError where a folder has no fit (or ``what``) of one.
    """
    for name in (selected := among(names, known)):
        if name not in known:
            raise InputError(
                f"no {what} of pad '{name}'", file=folder, remedy=f"name of {listed(known)}"
            )
    return selected


def source_of(files: Sequence[Path], pads: str, part: Shard) -> Source:
    """Return the named pads of some files, or all.

    Raise InputError on an unknown name in a single file.
    """
    from qlvbayes.pipeline.source import Source

    source = Source.from_files(files, shard=part)
    if source.read is None:
        return replace(source, only=tuple(split_names(pads)))
    known = [pad.name for pad in source.read.pads]
    names = (source.read.pad(name).name for name in among(pads, known))
    return replace(source, only=tuple(names))


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
