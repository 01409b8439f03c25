"""List the targets, and write the files of one from a folder of results."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

from qlvbayes.io import catalogue
from qlvbayes.io.catalogue import EXPORT_DRAWS
from qlvbayes.io.checks import InputError, check_known
from qlvbayes.io.files import results_folder, write_whole
from qlvbayes.use.exports.pad import read_pad
from qlvbayes.use.exports.target import AbstractTarget, Geometry

TARGETS: tuple[type[AbstractTarget], ...] = tuple(catalogue.loaded(catalogue.TARGETS).values())
"""Every target."""


def find(name: str) -> type[AbstractTarget]:
    """Return the target of that name, or raise InputError, which lists the known ones."""
    check_known("export to", name, catalogue.TARGETS)
    return next(target for target in TARGETS if target.name == name)


def export(
    out: str | Path,
    pad: str,
    to: str,
    *,
    draws: int = EXPORT_DRAWS,
    height: float | None = None,
    area: float | None = None,
    data: str | Path | None = None,
) -> list[Path]:
    """Write a fitted pad as files of another program into ``out/<pad>/export/<to>``; return them.

    All files or none: nothing is written until every one is there.

    Parameters
    ----------
    out, pad, to
        The folder of results, the name of the pad, and a target, as after ``--to``.
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
    target = find(to)()
    if draws < 1:
        raise InputError(f"{draws} draws", remedy="ask for one or more")
    date = datetime.now(UTC).date().isoformat()
    exported = read_pad(
        Path(out), pad, draws=draws, date=date, data=None if data is None else Path(data)
    )
    content = target.files(exported, specimen)
    folder = results_folder(exported.folder / "export" / to)
    for name, text in content.items():
        write_whole(folder / name, text)
    return [folder / name for name in content]


def _specimen(height: float | None, area: float | None) -> Geometry | None:
    if height is None and area is None:
        return None
    if height is None or area is None:
        raise InputError("a specimen has a height and an area", remedy="give both, in mm and mm2")
    if not (0.0 < height < float("inf") and 0.0 < area < float("inf")):
        raise InputError("height and area must be above 0", remedy="give them in mm and mm2")
    return Geometry(height, area)
