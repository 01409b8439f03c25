"""A C99 header: no memory of its own, no globals, a state that the caller keeps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from qlvbayes.io.checks import InputError
from qlvbayes.use.exports.card import card, in_comment, template
from qlvbayes.use.exports.expressions import TranslationError
from qlvbayes.use.exports.language import C, Language
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
