"""What every target offers. A new one is one class in one file, named in ``catalogue``."""

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
    """One program, format or language that a pad goes into.

    name: after ``--to``; what: the files, in one line; cannot: what of the model does not go along,
    each in one line; steps: whether it goes along with effects that step; without_steps: what
    becomes of them elsewhere.
    """

    name: ClassVar[str]
    what: ClassVar[str]
    cannot: ClassVar[tuple[str, ...]] = ()
    steps: ClassVar[bool] = False
    without_steps: ClassVar[str] = "its part of the force is left out"

    @abstractmethod
    def files(self, pad: ExportedPad, specimen: Geometry | None) -> dict[str, bytes]:
        """Content by file name.

        specimen: where the user told one. Raises InputError where this pad cannot go there.
        """
