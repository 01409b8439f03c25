"""A C99 header: no memory of its own, no globals, a state that the caller keeps."""

from __future__ import annotations

import numpy as np

from qlvbayes.io.checks import InputError
from qlvbayes.use.exports.card import card, in_comment, template
from qlvbayes.use.exports.formulas import FORMULAS, Formulas
from qlvbayes.use.exports.pad import Draws, ExportedPad
from qlvbayes.use.exports.target import AbstractTarget, Geometry
from qlvbayes.use.exports.translation import Language, functions_of, needs


class CHeader(AbstractTarget):
    """Force from the next displacement, displacement from the next force, in about 0.1 us."""

    name = "c"
    what = "a C99 header, and the posterior's draws as a table beside it"

    def files(self, pad: ExportedPad, specimen: Geometry | None) -> dict[str, bytes]:
        """``pad_B.h`` and ``pad_B_draws.h``."""
        return c_files(pad, type(self))


def c_files(pad: ExportedPad, target: type[AbstractTarget]) -> dict[str, bytes]:
    """The header and the table of draws, with the words of the target that holds them."""
    law = formulas_of(pad)
    name = pad.identifier
    values = {
        "p": name,
        "P": name.upper(),
        "card": in_comment(card(pad, target)),
        "constants": pad.constants,
        "loose": not pad.choices.bonded,
        "modes": pad.times.size,
        "functions": functions_of(law, C(name)),
        "library": needs(law),
        "units": pad.units,
        "middle": rows_of(pad.middle)[0],
        "draws": rows_of(pad.table),
    }
    header = template("pad.h.j2", **values)
    return {
        f"{name}.h": header.encode(),
        f"{name}_draws.h": template("draws.h.j2", **values).encode(),
    }


def formulas_of(pad: ExportedPad) -> Formulas:
    """The elastic law's formulas; InputError where it has none."""
    name = type(pad.elastic).name
    if name not in FORMULAS:
        raise InputError(
            f"the elastic law {name} cannot be written as code",
            remedy=f"use --to json, or fit with --elastic {'|'.join(FORMULAS)}",
        )
    return FORMULAS[name]


def rows_of(draws: Draws) -> list[tuple[list[str], list[str], list[str]]]:
    """Elastic constants, fractions and rates of each draw, in digits that lose nothing."""

    def digits(values: np.ndarray) -> list[str]:
        return [repr(float(x)) for x in values]

    rows = zip(draws.elastic, draws.fractions, draws.rates, strict=True)
    return [(digits(e), digits(c), digits(v)) for e, c, v in rows]


class C(Language):
    """C99 in the pad's own type of number."""

    def __init__(self, prefix: str) -> None:
        self.prefix = prefix

    def library(self, name: str) -> str:
        """A macro, of the function for float or for double."""
        return f"{self.prefix.upper()}_{name.upper()}"

    def number(self, value: float) -> str:
        """Cast, so that a float variant has no double in it."""
        return f"{self.prefix.upper()}_R({value!r})"

    def constant(self, name: str) -> str:
        """A member of the struct."""
        return f"k->{name}"

    def own(self, name: str) -> str:
        """With the pad's name before it."""
        return f"{self.prefix}_{name}"

    def either(self, condition: str, yes: str, no: str) -> str:
        """Only one of the two is evaluated."""
        return f"({condition} ? {yes} : {no})"

    def function(
        self, name: str, told: str, arguments: list[str], body: list[tuple[str, str]], result: str
    ) -> str:
        """Static and inline."""
        real = f"{self.prefix}_real"
        written = " ".join([*(text for _, text in body), result])
        typed = [
            f"const {self.prefix}_constants *k" if x == "k" else f"{real} {x}" for x in arguments
        ]
        lines = [f"    (void){x};" for x in arguments if not _stands_in(x, written)]
        lines += [f"    const {real} {key} = {text};" for key, text in body]
        head = f"static inline {real} {name}({', '.join(typed)})"
        return "\n".join([f"/* {told} */", head, "{", *lines, f"    return {result};", "}", ""])


def _stands_in(name: str, text: str) -> bool:
    letters = "".join(x if x.isalnum() or x == "_" else " " for x in text)
    return name in letters.split()
