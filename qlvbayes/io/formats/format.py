"""What a format of a testing machine is, and what it reads from a file."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

HEAD = 1 << 14  # bytes that a format may look at: the longest headers seen have a few thousand


@dataclass(frozen=True)
class Sight:
    """Which marks of a layout the first bytes of a file show, and which they lack."""

    found: tuple[str, ...]
    missing: tuple[str, ...]

    @classmethod
    def of(cls, marks: Mapping[str, bool]) -> Sight:
        """From each mark, in words, and whether it is there."""
        return cls(
            tuple(mark for mark, there in marks.items() if there),
            tuple(mark for mark, there in marks.items() if not there),
        )

    @property
    def whole(self) -> bool:
        """Whether the file is of this layout."""
        return bool(self.found) and not self.missing

    @property
    def share(self) -> float:
        """Share of the marks that are there, 0 to 1."""
        return len(self.found) / max(len(self.found) + len(self.missing), 1)


@dataclass(frozen=True, eq=False)
class Channel:
    """One channel as it stands in the file: values (n,), unit and name as they are written.

    ``quantity`` is time, displacement, force, strain or stress; ``unit`` is empty where the file
    does not say.
    """

    quantity: str
    values: Floats
    unit: str
    name: str


@dataclass(frozen=True, eq=False)
class Recording:
    """One test as a machine wrote it, nothing converted and nothing turned over.

    ``way`` is displacement or strain, ``load`` force or stress. ``load_time`` is the load's own
    clock, where it has one; ``began`` the date of time zero (s since 1970), where the file says;
    ``pressing`` says that this layout fixes the signs of both, so that nothing is asked: pressing
    is positive, and shear goes with its force;
    ``dropped`` counts the rows that are no measurements, by reason; ``unused`` are other columns.
    """

    time: Channel
    way: Channel
    load: Channel
    name: str = ""
    began: float | None = None
    load_time: Channel | None = None
    dropped: Mapping[str, int] = field(default_factory=dict)
    unused: tuple[str, ...] = ()
    pressing: bool = False


class AbstractFormat(ABC):
    """One layout of files.

    ``name`` is what messages call it; ``machine`` whose files these are; ``marks`` how they are
    recognised and ``reads`` what is read from them, each in one line; ``reference`` where the
    layout is described; ``general`` whether it gives way to every other layout that fits.
    """

    name: ClassVar[str]
    machine: ClassVar[str]
    marks: ClassVar[str]
    reads: ClassVar[str]
    reference: ClassVar[str]
    general: ClassVar[bool] = False

    @staticmethod
    @abstractmethod
    def sniff(head: bytes) -> Sight:
        """Which marks of the layout the first bytes of a file (at most ``HEAD``) show.

        Must not raise, whatever the bytes are.
        """

    @staticmethod
    @abstractmethod
    def read(path: Path) -> tuple[Recording, ...]:
        """Read the tests of one file, in its order.

        Raises
        ------
        InputError
            The file is not what its first bytes promised; it names the place and the remedy.
        """
