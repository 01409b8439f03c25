"""Define a test as a file holds it, as the package takes it, and the interface of formats."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from pathlib import Path
from typing import ClassVar, Literal

from qlvbayes.io.arrays import Array as Floats
from qlvbayes.io.arrays import Mask
from qlvbayes.io.checks import InputError, meant
from qlvbayes.io.units import UnitSystem
from qlvbayes.io.wording import listed

Role = Literal["fit", "validate"]

# As a file holds it


@dataclass(frozen=True)
class Sight:
    """Marks of a layout that the first bytes of a file show, and marks that they lack."""

    found: tuple[str, ...]
    missing: tuple[str, ...]

    @classmethod
    def from_marks(cls, marks: Mapping[str, bool]) -> Sight:
        """Return a sight from each mark, in words, and whether it is there."""
        found = tuple(mark for mark, there in marks.items() if there)
        return cls(found, tuple(mark for mark in marks if mark not in found))

    @property
    def whole(self) -> bool:
        """Return whether the file is of this layout."""
        return bool(self.found) and not self.missing


@dataclass(frozen=True)
class Stated:
    """Statements of a file on a test: ``specimen``, and when it ``began`` (s since 1970).

    ``began`` is on the machine's own clock, and None without a date and a time of the day.
    ``either`` is a date in which day and month may be exchanged, as written: ``began`` then serves
    within that day alone. ``named`` and ``dated`` are the lines of which both were taken.
    """

    specimen: str = ""
    began: float | None = None
    either: str = ""
    named: str = ""
    dated: str = ""

    def completed_by(self, other: Stated, *, of_rows: bool = False) -> Stated:
        """Return the statements with those of another on what these do not state.

        Those of one test's own rows, ``of_rows``, name its pad before lines above the table.
        """
        one, two = (other, self) if of_rows else (self, other)
        named = one if one.specimen else two
        dated = self if self.began is not None else other
        return Stated(named.specimen, dated.began, dated.either, named.named, dated.dated)


@dataclass(frozen=True, eq=False)
class Channel:
    """A channel as it is in the file."""

    quantity: str  # time, displacement, force, strain or stress
    values: Floats  # (n,) in the unit of the file
    unit: str  # the unit as it is written; empty where the file does not state it
    name: str  # the name as it is written


@dataclass(frozen=True, eq=False)
class Recording:
    """A test as a machine wrote it, with nothing converted and no sign changed."""

    time: Channel  # the clock of the displacement
    way: Channel  # displacement or strain
    load: Channel  # force or stress
    name: str = ""  # the test's name; empty where the file states none
    stated: Stated = Stated()  # the specimen, and when time was zero
    # the time of the first row as written, where it is one of the day: time then counts from there
    clock: str = ""
    load_time: Channel | None = None  # the load's own clock, where it has one
    # the number of rows that are no measurements, by reason
    dropped: Mapping[str, int] = field(default_factory=dict)
    unused: tuple[str, ...] = ()  # names of the other columns
    # whether this layout fixes the signs of both, so that the user is not asked: pressing is
    # positive, and shear has the sign of its force
    pressing: bool = False

    @property
    def channels(self) -> tuple[Channel, ...]:
        """Return time, displacement and force, and the force's own clock where it has one."""
        own = () if self.load_time is None else (self.load_time,)
        return (self.time, self.way, self.load, *own)

    def changed(self, change: Callable[[Floats], Floats]) -> Recording:
        """Return the recording with other values of each channel, in the order of `channels`."""
        changed = [replace(one, values=change(one.values)) for one in self.channels]
        time, way, load, *own = changed
        return replace(self, time=time, way=way, load=load, load_time=own[0] if own else None)


class UnsureError(InputError):
    """Exception for something that the file does not state.

    ``option`` states it, ``question`` asks for it.
    """

    def __init__(self, message: str, *, file: Path, option: str, question: str, say: str) -> None:
        super().__init__(message, file=file, remedy=f"say it with --{option} {say}")
        self.option = option
        self.question = question
        self._parts = message, file, say

    def elsewhere(self, command: str) -> InputError:
        """Return the same error for a command that lacks the option, naming one that has it."""
        message, file, say = self._parts
        return InputError(message, file=file, remedy=f"say it to {command} --{self.option} {say}")


class AbstractFormat(ABC):
    """Layout of the files of a testing machine or program.

    ``name`` is what messages call it, ``machine`` whose files these are and ``reference`` where the
    layout is described, each in one line. ``general`` is true where every other layout that fits
    takes precedence.
    """

    name: ClassVar[str]
    machine: ClassVar[str]
    reference: ClassVar[str]
    general: ClassVar[bool] = False

    @staticmethod
    @abstractmethod
    def sniff(head: bytes) -> Sight:
        """Return which marks of the layout the first bytes of a file show; it raises no error."""

    @staticmethod
    @abstractmethod
    def read(path: Path) -> tuple[Recording, ...]:
        """Return the tests of one file; an InputError names what is wrong, and the remedy."""


# As the package takes it


class Control(StrEnum):
    """The quantity that a testing machine prescribes; the other one responds."""

    DISPLACEMENT = "displacement"
    FORCE = "force"


@dataclass(frozen=True)
class Prescribed:
    """The quantity that is prescribed in a test from ``start`` to ``stop`` (s)."""

    control: Control
    start: float
    stop: float


@dataclass(frozen=True, eq=False)
class Test:
    """A test of one pad: n samples of time, displacement and force.

    name: The test's name, unique within its pad; pad: The pad's name; time: (n,) in s, rising;
    displacement: (n,) displacement or strain, in the file's own unit (`Pad.units`); force: (n,)
    force or stress, in the file's own unit; force_sd: (n,) measured standard deviation of each
    force; None where it was not measured; role: ``fit`` or ``validate``; None where the file does
    not say; rate: Declared loading rate, displacement over s; None where none is declared; start_s:
    Time of the pad's clock at the first sample (s); start_known: Whether ``start_s`` was measured;
    otherwise the tests follow without a pause; control: Which quantity was prescribed in the whole
    test; None where the file does not say, or where it changes within the test; changes: Stretches
    of time, one after another, with the quantity prescribed in each, where the file says that it
    changes within the test; else empty; contact_sd: Standard error of the displacement's zero, in
    the unit of displacement; None where it was not measured; contact_stage: Name of the stage whose
    contact is the test's zero, where it shares that error with the pad's other tests of that name;
    empty where its error is its own; tare_sd: Standard error of the force's zero, in the unit of
    force; 0 where it was not measured; used: (n,) whether the force of each sample is used; None
    where all are. The displacement is the specimen's history and always is; anew: (n,) whether the
    displacement of each sample was read anew; None where all were.
    """

    __test__: ClassVar[bool] = False  # pytest must not collect it

    name: str
    pad: str
    time: Floats
    displacement: Floats
    force: Floats
    force_sd: Floats | None = None
    role: Role | None = None
    rate: float | None = None
    start_s: float = 0.0
    start_known: bool = False
    control: Control | None = None
    changes: tuple[Prescribed, ...] = ()
    contact_sd: float | None = None
    contact_stage: str = ""
    tare_sd: float = 0.0
    used: Mask | None = None
    anew: Mask | None = None

    @property
    def states_control(self) -> bool:
        """True if the file states the prescribed quantity."""
        return self.control is not None or bool(self.changes)


@dataclass(frozen=True, eq=False)
class Pad:
    """A pad and its tests, in the file's order.

    name: The pad's name; tests: Its tests; units: The units of its displacements and forces; fluid:
    What fills the pad; None where the file does not say.
    """

    name: str
    tests: tuple[Test, ...]
    units: UnitSystem
    fluid: str | None = None


@dataclass(frozen=True, eq=False)
class Measurements:
    """All pads of one file, with its path, its SHA-256 and notices about how it was read."""

    pads: tuple[Pad, ...]
    units: UnitSystem
    source: str
    sha256: str
    notices: tuple[str, ...]

    def pad(self, name: str) -> Pad:
        """Return the pad of that name; an InputError lists the known names otherwise."""
        for pad in self.pads:
            if pad.name == name:
                return pad
        names = [pad.name for pad in self.pads]
        remedy = f"{meant(name, names)}name one of: {listed(names)}"
        raise InputError(f"no pad '{name}'", file=self.source, remedy=remedy)
