"""Read Biomomentum Mach-1: blocks of information and of data, a pair for each function."""

from __future__ import annotations

import re
from pathlib import Path
from typing import ClassVar

from qlvbayes.io.checks import InputError
from qlvbayes.io.formats.format import AbstractFormat, Recording, Sight
from qlvbayes.io.formats.textfile import cells_of, content, decoded
from qlvbayes.io.formats.texttable import in_cells, seconds_of, table

_BLOCK = re.compile(rb"<INFO>(.*?)<END INFO>.*?<DATA>[ \t]*\n(.*?)(?:<END DATA>|\Z)", re.DOTALL)
_LEAST = 10  # lines that a test has at least
_STRUCTURE = re.compile(rb"^<[^>\n]*>[^\n]*\n", re.MULTILINE)


class MachOne(AbstractFormat):
    """Blocks ``<INFO>`` and ``<DATA>`` of Mach-1; every function that moved the stage is a test.

    Position grows downwards, and force is negative in compression.
    """

    name: ClassVar[str] = "mach-1"
    machine: ClassVar[str] = "Biomomentum Mach-1 (text)"
    marks: ClassVar[str] = "a first line <Mach-1 File>, and a block <INFO>"
    reads: ClassVar[str] = "Time, s; Position (z), mm; Fz, gf or N, of every <DATA> block (a test)"
    reference: ClassVar[str] = "Mach-1 Motion user manual, data files"

    @staticmethod
    def sniff(head: bytes) -> Sight:
        """Look for its first line and its first block."""
        text = decoded(head)
        return Sight.from_marks(
            {
                "a first line <Mach-1 File>": text.lstrip().startswith("<Mach-1 File>"),
                "a block <INFO>": "<INFO>" in text,
            }
        )

    @staticmethod
    def read(path: Path) -> tuple[Recording, ...]:
        """Return one test for each block; blocks of a few lines, or without force, are left out."""
        data = content(path)
        blocks = list(_BLOCK.finditer(data))
        long = [block for block in blocks if block[2].count(b"\n") > _LEAST]
        if not long:
            remedy = "export the file again, with its data"
            raise InputError("there is no block <DATA> with rows", file=path, remedy=remedy)
        several = len(long) > 1
        return tuple(
            _test(block[1], block[2], path, data.count(b"\n", 0, block.start(2)), k * several)
            for k, block in enumerate(long, 1)
        )


def _test(info: bytes, rows: bytes, path: Path, line: int, number: int) -> Recording:
    """Return the test of a block whose names are in a line, from 0; 0 is the number of the only."""
    header, _, rest = rows.partition(b"\n")
    columns = in_cells(cells_of(header.decode("utf-8", "replace"), "\t"))
    settings = dict(_pairs(info))
    began = seconds_of(f"{settings.get('Date', '')} {settings.get('Time', '')}".split(".")[0])
    name = _function(info)
    title = f"{number} {name}".strip() if number else name
    lines = _STRUCTURE.sub(b"\n", rest)  # marks between the parts of one function
    return table(columns, lines, "\t", path, line, line + 1, name=title, began=began)


def _pairs(info: bytes) -> list[tuple[str, str]]:
    lines = info.decode("utf-8", "replace").split("\n")
    return [(k.strip(" :"), v.strip()) for k, _, v in (line.partition("\t") for line in lines) if v]


def _function(info: bytes) -> str:
    """Return the function that moved the stage: '<Stress Relaxation>' in the information."""
    names = re.findall(r"<([^>/]+)>", info.decode("utf-8", "replace"))
    return next((name for name in names if not name.startswith("END")), "")
