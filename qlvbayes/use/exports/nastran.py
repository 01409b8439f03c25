"""Bulk data entries of a viscoelastic material for Nastran and compatible solvers."""

from __future__ import annotations

from qlvbayes.use.exports.material import DENSITY, POISSON, AbstractDeck, Moduli, column, terms
from qlvbayes.use.exports.pad import ExportedPad

_WIDTH = 16  # of a large field


class Nastran(AbstractDeck):
    r"""``MAT1`` with ``MATVE``, model PRONY, in large fields of 16 columns.

    .. math:: G(t) = G_0 \Big(1 - \sum_i g_i (1 - e^{-t/\tau_i})\Big), \qquad g_i = c_i

    A field holds 13 to 15 digits, so that g(t) is kept to 1e-12. The layout of ``MATVE`` is that of
    OptiStruct's reference; the moduli of ``MAT1`` are those of the fast limit.
    """

    name = "nastran"
    what = "MAT1 with MATVE (PRONY), large fields (N, mm, s, MPa, t)"
    mark = "$"
    most = 5  # terms that MATVE's lines have room for
    room = f"MATVE has room for {most} terms"

    def lines(self, pad: ExportedPad, modulus: Moduli) -> dict[str, list[str]]:
        """Return the lines of ``pad_B.bdf``."""
        first, *others = [[_field(g), _field(tau)] for g, tau in terms(pad)]
        blank = [" " * _WIDTH]
        pairs = [field for pair in others for field in pair]
        elastic = ["1".rjust(_WIDTH), _field(modulus.young), *blank, _field(POISSON)]
        viscous = ["1".rjust(_WIDTH), "PRONY".rjust(_WIDTH), *first, *(4 * blank), *pairs]
        lines = [
            f"$ density (t/mm3): {DENSITY:g} is water's, of which tests say nothing",
            *_entry("MAT1", [*elastic, _field(DENSITY)]),
            "$ shares and times of the shear modulus; those of MAT1 are the fast limit's",
            *_entry("MATVE", viscous),
        ]
        return {".bdf": lines}


def _field(value: float) -> str:
    return column(value, _WIDTH, exponent="")


def _entry(name: str, fields: list[str]) -> list[str]:
    """Return an entry in lines of four large fields, of which it has an even number."""
    rows = [fields[i : i + 4] for i in range(0, len(fields), 4)]
    rows += [[]] if len(rows) % 2 else []
    heads = [f"{name}*", *["*"] * (len(rows) - 1)]
    return [f"{head:8}{''.join(row)}".rstrip() for head, row in zip(heads, rows, strict=True)]
