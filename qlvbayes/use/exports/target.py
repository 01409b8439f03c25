"""The interface of a target, the list of targets, and the writing of their files."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import ClassVar

from qlvbayes.io import catalogue
from qlvbayes.io.catalogue import EXPORT_DRAWS
from qlvbayes.io.checks import InputError, check_known
from qlvbayes.io.files import results_folder, write_whole
from qlvbayes.use.exports.pad import ExportedPad, read_pad


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


TARGETS: tuple[type[AbstractTarget], ...] = tuple(catalogue.loaded(catalogue.TARGETS).values())
"""Every target."""


def find(name: str) -> type[AbstractTarget]:
    """Return the target of that name, or raise InputError, which lists the known ones."""
    check_known("export to", name, catalogue.TARGETS)
    return next(target for target in TARGETS if target.name == name)


def export(
    out: str | Path,
    pad: str,
    *to: str,
    draws: int = EXPORT_DRAWS,
    height: float | None = None,
    area: float | None = None,
    data: str | Path | None = None,
) -> list[Path]:
    """Write a fitted pad as files of other programs into ``out/<pad>/export/<to>``; return them.

    All files of all targets or none: nothing is written until every one is there.

    Parameters
    ----------
    out, pad, to
        The folder of results, the name of the pad, and targets, each as after ``--to``.
    draws
        How many of the posterior, where the target takes more than one.
    height, area
        Of a homogeneous specimen (mm, mm2), which make a modulus of a stiffness.
    data
        The file of the pad's tests, where it is no longer where it was fitted from; the errors of
        simulators' contacts are stated against them.

    Raises
    ------
    InputError
        The results cannot be read, or the pad cannot go there.
    """
    specimen = _specimen(height, area)
    targets = [find(name)() for name in dict.fromkeys(to)]
    if draws < 1:
        raise InputError(f"{draws} draws", remedy="ask for one or more")
    date = datetime.now(UTC).date().isoformat()
    exported = read_pad(
        Path(out), pad, draws=draws, date=date, data=None if data is None else Path(data)
    )
    content: dict[Path, bytes] = {}
    for target in targets:
        try:
            files = target.files(exported, specimen)
        except InputError as error:  # of several, the one that cannot
            what = f"--to {target.name}: {error.message}" if len(targets) > 1 else error.message
            raise InputError(what, file=error.file, line=error.line, remedy=error.remedy) from error
        content |= {Path(target.name, name): text for name, text in files.items()}
    folder = exported.folder / "export"
    for target in targets:
        results_folder(folder / target.name)
    for path, text in content.items():
        write_whole(folder / path, text)
    return [folder / path for path in content]


def _specimen(height: float | None, area: float | None) -> Geometry | None:
    if height is None and area is None:
        return None
    if height is None or area is None:
        raise InputError("a specimen has a height and an area", remedy="give both, in mm and mm2")
    if not (0.0 < height < float("inf") and 0.0 < area < float("inf")):
        raise InputError("height and area must be above 0", remedy="give them in mm and mm2")
    return Geometry(height, area)
