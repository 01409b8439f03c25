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
from collections.abc import Sequence
from pathlib import Path

import numpy as np

import qlvbayes
from qlvbayes.io.checks import InputError
from qlvbayes.use.exports.card import ONE_DRAW, card, in_comment, template
from qlvbayes.use.exports.expressions import TranslationError
from qlvbayes.use.exports.language import C, Language, Matlab
from qlvbayes.use.exports.layer_code import MATERIAL, elastic_code, layers_code, library_of
from qlvbayes.use.exports.layers import ElasticFunction, ExportedLayer, elastic_functions
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
    law = functions_of(pad)
    name = pad.identifier
    language = C(name)
    values = {
        "p": name,
        "P": name.upper(),
        "card": in_comment(card(pad, target)),
        "constants": pad.constants,
        "modes": pad.times.size,
        "functions": elastic_code(law, language),
        "library": sorted(library_of(law, pad.pieces) | {"exp", "fmin"}),  # of every decay
        "units": pad.units,
        **layered(pad, language),
        "middle": rows_of(pad.middle)[0],
        "draws": rows_of(pad.table),
    }
    header = template("pad.h.j2", **values)
    return {
        f"{name}.h": header.encode(),
        f"{name}_draws.h": template("draws.h.j2", **values).encode(),
    }


def functions_of(pad: ExportedPad) -> list[ElasticFunction]:
    """Return the elastic law's functions; raise InputError where they cannot be written as code."""
    try:
        return elastic_functions(pad.elastic)
    except TranslationError as reason:
        raise InputError(
            f"the elastic law {type(pad.elastic).name} cannot be written as code",
            remedy="use --to json, or fit with another --elastic",
        ) from reason


def layered(pad: ExportedPad, language: Language) -> dict[str, object]:
    """Return what a template says of the layers: ``pieces`` is empty of a pad without effects."""
    pieces = pad.pieces if pad.effects else ()
    return {
        "loose": not pad.choices.bonded,
        "pieces": pieces,
        "layers": layers_code(pieces, language),
        "top": pieces[-1].name if pieces else MATERIAL,
        "touch": _touch(pieces, language),
        "one_way": in_comment([" ".join(pad.one_way.split())])[0],
    }


def _touch(pieces: Sequence[ExportedLayer], language: Language) -> str | None:
    """Return where it is remembered whether the specimen is touched."""
    way = language.say("top")
    for piece in reversed(pieces):
        if piece.touch is not None:
            return language.within(way, language.say("memory", piece.touch))
        way = language.within(way, language.beneath(piece.beneath - 1, piece.beneath))
    return None


def rows_of(draws: Draws) -> list[tuple[list[str], list[str], list[str]]]:
    """Return constants, fractions and rates of each draw, in all their digits."""

    def digits(values: np.ndarray) -> list[str]:
        return [repr(float(x)) for x in values]

    rows = zip(draws.elastic, draws.effects, draws.fractions, draws.rates, strict=True)
    return [([*digits(e), *digits(a)], digits(c), digits(v)) for e, a, c, v in rows]


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
            p=pad.identifier,
            card=card(pad, type(self)),
            constants=pad.constants,
            middle=rows_of(pad.middle)[0],
            functions=elastic_code(functions_of(pad), Matlab()),
            units=pad.units,
            **layered(pad, Matlab()),
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
