"""A machine's file where a tidy one was expected."""

from __future__ import annotations

from pathlib import Path

from qlvbayes.io.checks import InputError
from qlvbayes.io.formats.answers import UnsureError
from qlvbayes.io.formats.catalogue import FORMATS
from qlvbayes.io.formats.conversion import Conversion, convert
from qlvbayes.io.formats.recognise import head_of, matching
from qlvbayes.io.formats.two_clocks import TwoClocks
from qlvbayes.io.reading.dialect import Dialect


def machine_file(file: Path, tidy: Dialect | InputError) -> Conversion | None:
    """The tests of a machine's file, None where it is none.

    tidy: how it was read as a tidy file, or why it was not. A tidy header is taken at its word,
    unless there is a second clock beside it: to leave that out would make a lag.

    Raises
    ------
    InputError
        The file leaves open what only ``qlvbayes convert`` asks for, or it is damaged.
    """
    if isinstance(tidy, Dialect) and not tidy.columns.ignored:
        return None
    try:
        head = head_of(file)
    except InputError:
        return None
    whole, _, _ = matching(head, (TwoClocks,) if isinstance(tidy, Dialect) else FORMATS)
    if len(whole) != 1:
        return None
    try:
        return convert([file])
    except UnsureError as error:
        raise error.elsewhere(f"qlvbayes convert {file} -o tidy.csv") from error
