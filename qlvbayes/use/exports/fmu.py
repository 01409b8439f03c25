"""A functional mock-up unit: the C header behind the interface of FMI 2.0 co-simulation."""

from __future__ import annotations

import hashlib
import html
import io
import platform
import shutil
import subprocess
import tempfile
import zipfile
from pathlib import Path

import qlvbayes
from qlvbayes.use.exports.c_header import c_files, layered
from qlvbayes.use.exports.card import card, in_comment, template
from qlvbayes.use.exports.language import C
from qlvbayes.use.exports.pad import ExportedPad
from qlvbayes.use.exports.target import AbstractTarget, Geometry

_EPOCH = (1980, 1, 1, 0, 0, 0)  # the earliest date of a zip file: the same pad gives the same bytes
_COMPILE_S = 120.0  # after which a compiler is given up


class Fmu(AbstractTarget):
    """FMI 2.0 co-simulation without Python inside; states can be got, set and serialised.

    Inputs are the displacement, or with ``prescribe_force`` the force; ``draw`` takes one of the
    posterior's draws (0: the median). A step goes in a straight line to the input that is set
    before it; an importer that sets the input of the step's beginning, as most do, thus gets the
    exact force one step late. One that also sets the input's derivative gets it on time. Modelled
    on the Reference FMUs (https://github.com/modelica/Reference-FMUs).
    """

    name = "fmu"
    what = "an FMI 2.0 co-simulation unit: C sources, and a linux64 binary where there is gcc"
    steps = True

    def files(self, pad: ExportedPad, specimen: Geometry | None) -> dict[str, bytes]:
        """Return the content of ``pad_B.fmu``."""
        name = pad.identifier
        values = {
            "p": name,
            "P": name.upper(),
            "pad": pad,
            "units": pad.units,
            "card": in_comment(card(pad, type(self))),
            "version": qlvbayes.__version__,
            "draws": len(pad.table),
            **layered(pad, C(name)),
            "length_si": _si(pad.units.displacement),
            "force_si": _si(pad.units.force),
            "force_dimension": "stress" if pad.units.dimensionless else "force",
        }
        sources = c_files(pad, type(self))
        guid = _guid(sources)
        sources["fmu.c"] = template("fmu.c.j2", guid=guid, **values).encode()
        parts = {f"sources/{file}": content for file, content in sources.items()}
        described = template("modelDescription.xml.j2", guid=guid, **values)
        words = html.escape("\n".join(card(pad, type(self))))
        parts["modelDescription.xml"] = described.encode()
        parts["documentation/index.html"] = f"<!DOCTYPE html><pre>{words}</pre>\n".encode()
        if (binary := _binary(sources)) is not None:
            parts[f"binaries/linux64/{name}.so"] = binary
        return {f"{name}.fmu": _zipped(parts)}


def _si(unit: str) -> float:
    """Return what one of the unit is in m, N or Pa."""
    lengths = {"mm": 1e-3, "um": 1e-6, "nm": 1e-9, "m": 1.0, "1": 1.0}
    forces = {"N": 1.0, "mN": 1e-3, "uN": 1e-6, "nN": 1e-9, "kPa": 1e3, "MPa": 1e6, "Pa": 1.0}
    return (lengths | forces)[unit]


def _guid(sources: dict[str, bytes]) -> str:
    digest = hashlib.sha256(b"".join(sources.values())).hexdigest()
    parts = (digest[:8], digest[8:12], digest[12:16], digest[16:20], digest[20:32])
    return "{" + "-".join(parts) + "}"


def _binary(sources: dict[str, bytes]) -> bytes | None:
    """Return the shared library; None where this machine cannot make one."""
    gcc = shutil.which("gcc")
    if gcc is None or platform.system() != "Linux" or platform.machine() != "x86_64":
        return None
    with tempfile.TemporaryDirectory() as folder:
        for file, content in sources.items():
            (Path(folder) / file).write_bytes(content)
        flags = ("-std=c99", "-O2", "-shared", "-fPIC", "-fvisibility=hidden")
        command = [gcc, *flags, "-o", "unit.so", "fmu.c", "-lm"]
        try:
            done = subprocess.run(command, cwd=folder, capture_output=True, timeout=_COMPILE_S)
        except (OSError, subprocess.TimeoutExpired):
            return None
        return (Path(folder) / "unit.so").read_bytes() if done.returncode == 0 else None


def _zipped(parts: dict[str, bytes]) -> bytes:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in parts.items():
            entry = zipfile.ZipInfo(name, _EPOCH)
            entry.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(entry, data)
    return content.getvalue()
