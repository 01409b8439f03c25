"""Code of a pad: a C99 header, a functional mock-up unit around it, and a function for MATLAB."""

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
from typing import Any

import qlvbayes
from qlvbayes.effects.sensors import LINES
from qlvbayes.io.checks import InputError
from qlvbayes.io.units import unit_system
from qlvbayes.use.exports.card import ONE_DRAW, card, in_comment, template
from qlvbayes.use.exports.expressions import TranslationError
from qlvbayes.use.exports.language import (
    MATERIAL,
    MATLAB,
    Language,
    elastic_code,
    in_c,
    layers_code,
    library_of,
    touch_of,
)
from qlvbayes.use.exports.layers import LINE, ElasticFunction, elastic_functions
from qlvbayes.use.exports.pad import Draws, ExportedPad
from qlvbayes.use.exports.target import AbstractTarget, Geometry


class CHeader(AbstractTarget):
    """Force from the next displacement, displacement from the next force, in about 0.1 us."""

    name = "c"
    what = "a C99 header, and the posterior's draws as a table next to it"
    steps = True

    def files(self, pad: ExportedPad, specimen: Geometry | None) -> dict[str, bytes]:
        """Return the content of ``pad_B.h`` and ``pad_B_draws.h``."""
        return c_files(pad, type(self))


def c_files(pad: ExportedPad, target: type[AbstractTarget]) -> dict[str, bytes]:
    """Return the header and the table of draws, with the words of the target that holds them."""
    law, name = _functions_of(pad), pad.identifier
    language = in_c(name)
    values = {
        **values_of(pad, target, language),
        "functions": elastic_code(law, language),
        "library": sorted(library_of(law, pad.pieces) | {"exp", "fmin"}),  # of every decay
        "middle": _rows_of(pad.middle, language)[0],
        "draws": _rows_of(pad.table, language),
    }
    return {
        f"{name}.h": template("pad.h.j2", **values).encode(),
        f"{name}_draws.h": template("draws.h.j2", **values).encode(),
    }


def _functions_of(pad: ExportedPad) -> list[ElasticFunction]:
    """Return the elastic law's functions; raise InputError where they cannot be written as code."""
    try:
        return elastic_functions(pad.elastic)
    except TranslationError as reason:
        raise InputError(
            f"the elastic law {type(pad.elastic).name} cannot be written as code",
            remedy="use --to json, or fit with another --elastic",
        ) from reason


def values_of(pad: ExportedPad, target: type[AbstractTarget], language: Language) -> dict[str, Any]:
    """Return what a template says of the pad and of its layers."""
    return {
        "p": pad.identifier,
        "P": pad.identifier.upper(),
        "pad": pad,
        "units": pad.units,
        "card": in_comment(card(pad, target)),
        "loose": not pad.choices.bonded,
        "layers": list(layers_code(pad.pieces, language)),
        "top": pad.pieces[-1].name if pad.pieces else MATERIAL,
        "touch": touch_of(pad.pieces, language),
        "one_way": in_comment([" ".join(pad.one_way.split())])[0],
        "line": LINE,
        "most": LINES,
    }


def _rows_of(draws: Draws, language: Language) -> list[tuple[str, str, str]]:
    """Return constants, fractions and rates of each draw, in all their digits."""

    def listed(*parts: Any) -> str:
        return ", ".join(language.say("number", float(x)) for part in parts for x in part)

    rows = zip(draws.elastic, draws.effects, draws.fractions, draws.rates, strict=True)
    return [(listed(e, a), listed(c), listed(v)) for e, a, c, v in rows]


class MatlabFunction(AbstractTarget):
    """Force from the next displacement and displacement from the next force, with a state."""

    name = "matlab"
    what = "a function for MATLAB and GNU Octave"
    steps = True
    cannot = (ONE_DRAW,)

    def files(self, pad: ExportedPad, specimen: Geometry | None) -> dict[str, bytes]:
        """Return the content of ``pad_B.m``."""
        text = template(
            "pad.m.j2",
            **values_of(pad, type(self), MATLAB),
            functions=elastic_code(_functions_of(pad), MATLAB),
            middle=_rows_of(pad.middle, MATLAB)[0],
        )
        return {f"{pad.identifier}.m": text.encode()}


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
        si = unit_system(*(("1", "Pa") if pad.units.dimensionless else ("m", "N")))
        values = {
            **values_of(pad, type(self), in_c(name)),
            "version": qlvbayes.__version__,
            "draws": len(pad.table),
            "length_si": pad.units.factor_to(si, "displacement"),
            "force_si": pad.units.factor_to(si, "force"),
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
