"""Read files of testing machines with the user's answers, and ask for those that are missing."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import typer

from qlvbayes.cli.console import err, waiting
from qlvbayes.cli.settings import KEYS, StudySettings
from qlvbayes.io.conversion import Conversion, convert
from qlvbayes.io.recording import UnsureError


def converted(
    files: Sequence[Path], settings: StudySettings, pads: tuple[str, ...] = ()
) -> Conversion:
    """Convert files; on a terminal ask for what they leave open, as often as needed."""
    asks = sys.stdin.isatty() and err.is_terminal
    while True:
        try:
            with waiting("reading"):
                conversion = convert(
                    files, settings.answers(pads), settings.formats, without_faulty=True
                )
            open_ = (
                fault for fault in conversion.faults if asks and isinstance(fault, UnsureError)
            )
            if (unsure := next(open_, None)) is None:
                return conversion
            raise unsure
        except UnsureError as error:
            if not asks:
                raise
            err.print(str(error))
            kind = KEYS[error.option].kind
            answer = typer.prompt(error.question, type=kind, err=True)
            settings = StudySettings(settings.values | {error.option: answer})
