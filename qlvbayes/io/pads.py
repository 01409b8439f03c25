"""Define a study: pads, each with its tests, as all other parts of the package take them."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import ClassVar, Literal

from qlvbayes.io.arrays import Array as Floats
from qlvbayes.io.arrays import Mask
from qlvbayes.io.checks import InputError, meant
from qlvbayes.io.units import UnitSystem
from qlvbayes.io.wording import listed

Role = Literal["fit", "validate"]


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
