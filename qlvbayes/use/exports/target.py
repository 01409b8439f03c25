"""The interface of a target. A new one is one class in one file, named in ``catalogue``."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

from qlvbayes.use.exports.pad import ExportedPad


@dataclass(frozen=True)
class Geometry:
    """The shape of a homogeneous specimen: height (mm) and cross-section (mm2)."""

    height: float
    area: float


class AbstractTarget(ABC):
    """Program, format or language that a pad is exported to.

    name: Its name after ``--to``; what: Its files, in one line; cannot: Parts of the model that it
    cannot represent, each in one line; steps: Whether it takes effects that go step by step;
    without_steps: What becomes of such effects in a target that does not.
    """

    name: ClassVar[str]
    what: ClassVar[str]
    cannot: ClassVar[tuple[str, ...]] = ()
    steps: ClassVar[bool] = False
    without_steps: ClassVar[str] = "its part of the force is left out"

    @abstractmethod
    def files(self, pad: ExportedPad, specimen: Geometry | None) -> dict[str, bytes]:
        """Return the content of the files of a fitted pad, by name.

        ``specimen`` is its shape, None where the user gave none. An InputError where the target
        cannot represent this pad.
        """
