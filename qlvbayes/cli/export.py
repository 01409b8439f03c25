"""``qlvbayes export``: a fitted pad as files for other programs."""

from __future__ import annotations

import json
from pathlib import Path

from qlvbayes.cli.console import out, waiting
from qlvbayes.cli.options import split_names
from qlvbayes.io.catalogue import EXPORT_DRAWS, TARGETS
from qlvbayes.io.checks import InputError

_NAMES = "|".join(TARGETS)


def export(
    folder: Path,
    to: str,
    pads: str = "",
    draws: int = EXPORT_DRAWS,
    height: float | None = None,
    area: float | None = None,
    data: Path | None = None,
    as_json: bool = False,
) -> None:
    """Write a fitted pad for simulation and control, into OUT/<pad>/export/.

    c: a C99 header; fmu: an FMI 2.0 unit; matlab; mujoco, drake: a contact, with its error against
    the measured forces; abaqus, febio: a material, of a homogeneous specimen; prony: its table, for
    every other program; curves: tables; json: everything. Each says its units, its date, what was
    tested, the 90 % intervals, and what it cannot represent.

    Options:
    to: One of {_NAMES}, or several as 'c,fmu'.
    pads --pads --pad: The pad. Default: the only one.
    draws 1..: Draws of the posterior, where the target takes them.
    height: Height (mm) of a homogeneous specimen, for a modulus of a material.
    area: Its cross-section (mm2).
    """
    # imported here, so that the help does not wait for them
    from qlvbayes.use.exports.target import export as write_for
    from qlvbayes.use.exports.target import find

    names = split_names(to)
    if not names:
        raise InputError("no target", remedy=f"give --to {_NAMES}")
    kinds = {name: find(name) for name in names}
    fitted = sorted(path.parent.name for path in folder.glob("*/posterior.nc"))
    if not pads and len(fitted) > 1:
        what = f"several pads are in this folder: {', '.join(fitted)}"
        raise InputError(what, file=folder, remedy=f"name one, as --pad {fitted[0]}")
    pad = pads or "".join(fitted)
    with waiting(f"export to {', '.join(kinds)}"):
        files = write_for(folder, pad, *kinds, draws=draws, height=height, area=area, data=data)
    written = {name: [str(path) for path in files if path.parent.name == name] for name in kinds}
    if as_json:
        print(json.dumps(written))
        return
    for name, paths in written.items():
        out.print(f"{name}: {kinds[name].what}", soft_wrap=True)
        for path in paths:
            out.print(f"  {path}", soft_wrap=True)
