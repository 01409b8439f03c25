"""A function for MATLAB and GNU Octave, from the same formulas as the C header."""

from __future__ import annotations

from qlvbayes.use.exports.c_header import formulas_of, rows_of
from qlvbayes.use.exports.card import ONE_DRAW, card, template
from qlvbayes.use.exports.pad import ExportedPad
from qlvbayes.use.exports.target import AbstractTarget, Geometry
from qlvbayes.use.exports.translation import Language, functions_of


class Matlab(AbstractTarget):
    """Force from the next displacement and displacement from the next force, with a state."""

    name = "matlab"
    what = "a function for MATLAB and GNU Octave"
    cannot = (ONE_DRAW,)

    def files(self, pad: ExportedPad, specimen: Geometry | None) -> dict[str, bytes]:
        """``pad_B.m``."""
        text = template(
            "pad.m.j2",
            p=pad.identifier,
            card=card(pad, type(self)),
            constants=pad.constants,
            middle=rows_of(pad.middle)[0],
            loose=not pad.choices.bonded,
            functions=functions_of(formulas_of(pad), M()),
            units=pad.units,
        )
        return {f"{pad.identifier}.m": text.encode()}


class M(Language):
    """MATLAB's language; both sides of a choice are evaluated, and one is taken."""

    def library(self, name: str) -> str:
        """The same names but one."""
        return "power" if name == "pow" else name

    def number(self, value: float) -> str:
        """As it stands."""
        return repr(value)

    def constant(self, name: str) -> str:
        """A field of the structure."""
        return f"k.{name}"

    def own(self, name: str) -> str:
        """A local function."""
        return f"{name}_"

    def either(self, condition: str, yes: str, no: str) -> str:
        """By a function."""
        return f"pick_({condition}, {yes}, {no})"

    def function(
        self, name: str, told: str, arguments: list[str], body: list[tuple[str, str]], result: str
    ) -> str:
        """Local to the file."""
        lines = [f"  {key} = {text};" for key, text in body]
        head = f"function result_ = {name}({', '.join(arguments)})"
        return "\n".join([head, f"  % {told}", *lines, f"  result_ = {result};", "end", ""])
