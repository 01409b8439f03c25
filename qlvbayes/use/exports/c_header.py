"""A C99 header: no memory of its own, no globals, a state that the caller keeps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from qlvbayes.effects.channel_lag import LINES
from qlvbayes.io.checks import InputError
from qlvbayes.use.exports.card import card, in_comment, template
from qlvbayes.use.exports.expressions import TranslationError
from qlvbayes.use.exports.language import Language
from qlvbayes.use.exports.layer_code import MATERIAL, elastic_code, layers_code, library_of
from qlvbayes.use.exports.layers import LINE, ElasticFunction, ExportedLayer, elastic_functions
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
    way = language.top
    for piece in reversed(pieces):
        if piece.touch is not None:
            return language.within(way, language.memory(piece.touch))
        way = language.within(way, language.beneath(piece.beneath - 1, piece.beneath))
    return None


def rows_of(draws: Draws) -> list[tuple[list[str], list[str], list[str]]]:
    """Return constants, fractions and rates of each draw, in all their digits."""

    def digits(values: np.ndarray) -> list[str]:
        return [repr(float(x)) for x in values]

    rows = zip(draws.elastic, draws.effects, draws.fractions, draws.rates, strict=True)
    return [([*digits(e), *digits(a)], digits(c), digits(v)) for e, a, c, v in rows]


class C(Language):
    """C99 in the pad's own type of number: a variant for float has no double in it."""

    def __init__(self, prefix: str) -> None:
        self.prefix = prefix

    def library(self, name: str) -> str:
        return f"{self.prefix.upper()}_{name.upper()}"

    def number(self, value: float) -> str:
        return f"{self.prefix.upper()}_R({value!r})"

    def constant(self, name: str) -> str:
        return f"k->{name}"

    def own(self, name: str) -> str:
        return f"{self.prefix}_{name}"

    def either(self, condition: str, yes: str, no: str) -> str:
        return f"({condition} ? {yes} : {no})"

    def function(self, one: ElasticFunction, body: list[str], result: str) -> str:
        real, written = f"{self.prefix}_real", " ".join([*body, result])
        typed = [f"const {self.prefix}_constants *k", *(f"{real} {x}" for x in one.arguments)]
        lines = [f"    (void){x};" for x in ("k", *one.arguments) if not _stands_in(x, written)]
        lines += [f"    {line}" for line in (*body, f"return {result};")]
        head = f"static inline {real} {self.own(one.name)}({', '.join(typed)})"
        return "\n".join([f"/* {one.summary} */", head, "{", *lines, "}", ""])

    def truth(self, value: bool) -> str:
        return str(int(value))

    def opposite(self, condition: str) -> str:
        return f"(!{condition})"

    top = "s->top"

    def within(self, way: str, member: str) -> str:
        return f"{way}.{member.removeprefix('s->')}"

    def memory(self, index: int) -> str:
        return f"s->m[{index}]"

    def beneath(self, index: int, count: int) -> str:
        return "s->below" if count == 1 else f"s->below[{index}]"

    def set(self, name: str, text: str, *, truth: bool) -> str:
        kind = "int" if truth else f"{self.prefix}_real"
        return f"const {kind} {name} = {text};"

    def remember(self, index: int, text: str) -> str:
        return f"s->m[{index}] = {text};"

    def declared(self, below: str, name: str) -> str:
        return f"{self.prefix}_{below}_state {name};"

    def copy(self, below: str, name: str, location: str) -> str:
        return f"{self.prefix}_{below}_state {name} = {location};"

    def begin(self, below: str, location: str, displacement: str) -> str:
        return f"{self.prefix}_begin_{below}(k, &{location}, {displacement});"

    def step(self, below: str, name: str | None, location: str, line: list[str]) -> str:
        call = f"{self.prefix}_step_{below}(k, &{location}, {', '.join(line)});"
        return call if name is None else f"const {self.prefix}_real {name} = {call}"

    def layer(self, piece: ExportedLayer, below: str, begin: list[str], step: list[str]) -> str:
        p, state = self.prefix, f"{self.prefix}_{piece.name}_state"
        count = "" if piece.beneath == 1 else f"[{piece.beneath}]"
        members = [f"    {p}_{below}_state below{count};"]
        members += [f"    {p}_real m[{piece.memory}];"] if piece.memory else []
        struct = ["typedef struct {", *members, f"}} {state};"]
        given = f"const {p}_constants *k, {state} *s"
        heads = (
            (f"static inline void {p}_begin_{piece.name}({given}, {p}_real displacement)", begin),
            (
                f"static inline {p}_real {p}_step_{piece.name}({given}, {p}_real h, {p}_real to,\n"
                f"    {p}_real speed, {p}_real clear, int followed)",
                [*step, "return force;"],
            ),
        )
        formula = in_comment([" ".join(piece.formula.split())])[0]
        text = [f"/* {piece.name}: {formula} */", *struct, ""]
        for head, body in heads:
            names = ("k", "displacement") if body is begin else ("k", *LINE, "followed")
            unused = [f"(void){x};" for x in names if not _stands_in(x, " ".join(body))]
            text += [head, "{", *(f"    {line}" for line in (*unused, *body)), "}", ""]
        return "\n".join(text)

    def late(self, piece: ExportedLayer, below: str) -> str:
        names = {"p": self.prefix, "P": self.prefix.upper(), "delay": piece.constants[0]}
        return template("late.h.j2", piece=piece, below=below, most=LINES, **names)


def _stands_in(name: str, text: str) -> bool:
    letters = "".join(x if x.isalnum() or x == "_" else " " for x in text)
    return name in letters.split()
