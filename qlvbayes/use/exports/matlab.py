"""A function for MATLAB and GNU Octave, from the same expressions as the C header."""

from __future__ import annotations

from qlvbayes.use.exports.c_header import functions_of, layered, rows_of
from qlvbayes.use.exports.card import ONE_DRAW, card, template
from qlvbayes.use.exports.language import Matlab
from qlvbayes.use.exports.layer_code import elastic_code
from qlvbayes.use.exports.pad import ExportedPad
from qlvbayes.use.exports.target import AbstractTarget, Geometry


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
