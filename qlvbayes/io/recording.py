"""Define what a file holds, as it is written there, and the interface of formats that read it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import ClassVar, Protocol

from qlvbayes.io.arrays import Array as Floats
from qlvbayes.io.checks import InputError


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

    def completed_by(self, other: Stated) -> Stated:
        """Return the statements with those of another on what these do not state."""
        named = self if self.specimen else other
        dated = self if self.began is not None else other
        return Stated(named.specimen, dated.began, dated.either, named.named, dated.dated)

    def with_labels(self, own: Stated) -> Stated:
        """Return the statements above a table with those of one test's rows, which name its pad."""
        named = own if own.specimen else self
        whole = self.completed_by(own)
        return replace(whole, specimen=named.specimen, named=named.named)


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


class Format(Protocol):
    """Reader of files of one layout: a class under `AbstractFormat`, or a row of a table."""

    @property
    def name(self) -> str:
        """Return the name in messages."""

    @property
    def machine(self) -> str:
        """Return whose files these are."""

    @property
    def general(self) -> bool:
        """Return whether every other layout that fits takes precedence."""

    def sniff(self, head: bytes) -> Sight:
        """Return which marks of the layout the first bytes of a file show."""

    def read(self, path: Path) -> tuple[Recording, ...]:
        """Return the tests of one file."""


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
