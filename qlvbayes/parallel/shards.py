"""Define one part of many: ``3/200`` is the third of two hundred, each run by itself."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

from qlvbayes.io.checks import InputError

Item = TypeVar("Item")

_TASK, _FIRST, _COUNT = (f"SLURM_ARRAY_TASK_{what}" for what in ("ID", "MIN", "COUNT"))


@dataclass(frozen=True)
class Shard:
    """The part with this index, from 1, of ``count``; every item is in exactly one part."""

    index: int = 1
    count: int = 1

    @classmethod
    def from_text(cls, text: str) -> Shard:
        """Read ``3/200``, or ``slurm``: the index of this job in an array of SLURM."""
        if text.strip().lower() == "slurm":
            return cls._from_slurm()
        index, slash, count = (part.strip() for part in text.partition("/"))
        if index.lower() == "slurm":  # of an array that is smaller than the number of parts
            index = str(cls._from_slurm().index)
        if not (slash and index.isdecimal() and count.isdecimal()):
            raise InputError(f"no part {text!r}", remedy="write it as 3/200, or as slurm")
        if not 1 <= int(index) <= int(count):
            raise InputError(
                f"no part {index} of {count}", remedy=f"use 1/{count} to {count}/{count}"
            )
        return cls(int(index), int(count))

    @classmethod
    def _from_slurm(cls) -> Shard:
        values = [os.environ.get(name, "") for name in (_TASK, _FIRST, _COUNT)]
        if not all(text.isdecimal() for text in values):
            raise InputError(
                "this is no job of a SLURM array: SLURM_ARRAY_TASK_ID is not set",
                remedy="run it by sbatch --array=1-200, or write the part as 3/200",
            )
        task, first, count = map(int, values)
        if not 1 <= task - first + 1 <= count:
            raise InputError(
                f"the SLURM array has gaps: task {task} of {count} that begin with {first}",
                remedy="number it without gaps, as --array=1-200, or write the part as 3/200",
            )
        return cls(task - first + 1, count)

    def part(self, items: Sequence[Item]) -> Sequence[Item]:
        """Return every ``count``-th item, from the index on."""
        return items[self.index - 1 :: self.count]
