"""List what the results can be used for: commands, and what was exported already."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from qlvbayes.io.escaping import as_typed
from qlvbayes.report.collect import PadResults, Results


@dataclass(frozen=True)
class Use:
    """A thing to do, and the command that does it."""

    what: str
    command: str


@dataclass(frozen=True)
class Exported:
    """Files of one pad for another program; folder: in the folder of results."""

    pad: str
    target: str
    folder: str
    files: tuple[str, ...]


@dataclass(frozen=True)
class Using:
    """Commands that use a fitted pad, and the exports that are there."""

    commands: tuple[Use, ...]
    exports: tuple[Exported, ...]


def using_of(results: Results) -> Using | None:
    """Return how the first fitted pad is used; None where none was fitted."""
    fitted = [pad for pad in results.pads if (pad.folder / "posterior.nc").exists()]
    if not fitted:
        return None
    out, pad = results.out.name or "OUT", fitted[0]
    commands = (
        Use(
            "What a pad does in a motion, or under a load, that no test had, with 90 % bands",
            as_typed("qlvbayes", "predict", out, "--pad", pad.name, "--program", _program(pad)),
        ),
        Use(
            "The pad in a controller, a simulation or finite elements: C, FMU, MuJoCo, Drake, "
            "MATLAB, Abaqus, FEBio, tables, JSON",
            as_typed("qlvbayes", "export", out, "--pad", pad.name, "--to", "c,fmu,json"),
        ),
        Use(
            "The most informative next tests, for the constants and for the cause",
            as_typed("qlvbayes", "design", out, "--pad", pad.name),
        ),
    )
    exports = [one for pad in fitted for one in _exports(results.out, pad)]
    return Using(commands, tuple(exports))


def _program(pad: PadResults) -> str:
    """Return a press as deep and as fast as the tests went, where that is known."""
    unit = str(pad.final.facts.get("displacement_unit", "mm")).replace("1", "strain")
    try:
        covered = json.loads(pad.final.facts.get("covered", ""))
        depth, speed = float(covered["depth"]), float(covered["fastest"])
    except (ValueError, KeyError, TypeError):
        return f"ramp 1 {unit} in 0.1 s, hold 30 s"
    return f"ramp {depth:.3g} {unit} in {depth / speed:.3g} s, hold 30 s"


def _exports(out: Path, pad: PadResults) -> list[Exported]:
    folders = [path for path in sorted(pad.folder.glob("export/*")) if path.is_dir()]
    return [
        Exported(
            pad.name,
            folder.name,
            folder.relative_to(out).as_posix(),
            tuple(sorted(path.name for path in folder.iterdir() if path.is_file())),
        )
        for folder in folders
    ]
