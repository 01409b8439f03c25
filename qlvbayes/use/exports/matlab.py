"""A function for MATLAB and GNU Octave, from the same expressions as the C header."""

from __future__ import annotations

from qlvbayes.effects.channel_lag import LINES
from qlvbayes.use.exports.c_header import functions_of, layered, rows_of
from qlvbayes.use.exports.card import ONE_DRAW, card, template
from qlvbayes.use.exports.language import Language
from qlvbayes.use.exports.layer_code import elastic_code
from qlvbayes.use.exports.layers import LINE, ElasticFunction, ExportedLayer
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
            functions=elastic_code(functions_of(pad), M()),
            units=pad.units,
            **layered(pad, M()),
        )
        return {f"{pad.identifier}.m": text.encode()}


class M(Language):
    """MATLAB's language; both sides of a choice are evaluated, and one is taken."""

    def library(self, name: str) -> str:
        return {"pow": "power", "fabs": "abs", "fmax": "max", "fmin": "min"}.get(name, name)

    def number(self, value: float) -> str:
        return repr(value)

    def constant(self, name: str) -> str:
        return f"k.{name}"

    def own(self, name: str) -> str:
        return f"{name}_"

    def either(self, condition: str, yes: str, no: str) -> str:
        return f"pick_({condition}, {yes}, {no})"

    def function(self, one: ElasticFunction, body: list[str], result: str) -> str:
        lines = [f"  {line}" for line in body]
        head = f"function result_ = {self.own(one.name)}({', '.join(['k', *one.arguments])})"
        return "\n".join([head, f"  % {one.summary}", *lines, f"  result_ = {result};", "end", ""])

    def truth(self, value: bool) -> str:
        return "true" if value else "false"

    def opposite(self, condition: str) -> str:
        return f"(~{condition})"

    top = "state.top"

    def within(self, way: str, member: str) -> str:
        return f"{way}.{member.removeprefix('state.')}"

    def memory(self, index: int) -> str:
        return f"state.m({index + 1})"

    def beneath(self, index: int, count: int) -> str:
        return "state.below" if count == 1 else f"state.below{{{index + 1}}}"

    def set(self, name: str, text: str, *, truth: bool) -> str:
        return f"{name} = {text};"

    def remember(self, index: int, text: str) -> str:
        return f"state.m({index + 1}) = {text};"

    def declared(self, below: str, name: str) -> str:
        return f"{name} = struct();"

    def copy(self, below: str, name: str, location: str) -> str:
        return f"{name} = {location};"

    def begin(self, below: str, location: str, displacement: str) -> str:
        return f"{location} = begin_{below}_(k, {displacement});"

    def step(self, below: str, name: str | None, location: str, line: list[str]) -> str:
        call = f"step_{below}_(k, {location}, {', '.join(line)})"
        return f"[{name or '~'}, {location}] = {call};"

    def layer(self, piece: ExportedLayer, below: str, begin: list[str], step: list[str]) -> str:
        given = f"k, state, {', '.join(LINE)}, followed"
        text = [
            f"function state = begin_{piece.name}_(k, displacement)",
            f"  % {piece.name}: {' '.join(piece.formula.split())}",
            *(f"  {line}" for line in begin),
            *(["  state = struct();"] if not begin else []),
            "end",
            "",
            f"function [force, state] = step_{piece.name}_({given})",
            *(f"  {line}" for line in step),
            "end",
            "",
        ]
        return "\n".join(text)

    def late(self, piece: ExportedLayer, below: str) -> str:
        delay = piece.constants[0]
        return template("late.m.j2", piece=piece, below=below, delay=delay, most=LINES)
