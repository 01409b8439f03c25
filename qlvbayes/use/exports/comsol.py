"""Branches of a generalized Maxwell model for COMSOL Multiphysics."""

from __future__ import annotations

from qlvbayes.use.exports.card import card, commented
from qlvbayes.use.exports.material import CANNOT, POISSON, moduli, structure
from qlvbayes.use.exports.pad import ExportedPad
from qlvbayes.use.exports.target import AbstractTarget, Geometry

_PASCAL = 1e6  # of a MPa


class Comsol(AbstractTarget):
    r"""Three columns for the table of branches, and the moduli of the parent material.

    .. math:: G(t) = G + \sum_m G_m e^{-t/\tau_m}, \qquad G = c_0 G_0, \quad G_m = c_m G_0

    The parent's moduli are long-term, as COMSOL takes them by default.
    """

    name = "comsol"
    what = "a table of branch, shear modulus (Pa) and time (s), with the long-term parent"
    cannot = CANNOT

    def files(self, pad: ExportedPad, specimen: Geometry | None) -> dict[str, bytes]:
        """Return the content of ``pad_B_branches.txt`` and ``pad_B_parent.txt`` (parameters)."""
        modulus = moduli(pad, specimen)
        said = card(pad, type(self), structure(pad))
        head = commented(said, "%")
        shear = _PASCAL * modulus.shear
        rows = zip((shear * pad.fractions[1:]).tolist(), pad.times.tolist(), strict=True)
        branches = [f"{m} {g!r} {tau!r}" for m, (g, tau) in enumerate(rows, 1)]
        parent = [
            f'G_long {shear * float(pad.fractions[0])!r}[Pa] "shear modulus, long-term"',
            f'K_bulk {_PASCAL * modulus.bulk!r}[Pa] "bulk modulus, Poisson ratio {POISSON} fast"',
        ]
        columns = "% branch, shear modulus (Pa), relaxation time (s)\n"
        return {
            f"{pad.identifier}_branches.txt": (
                head + columns + "\n".join(branches) + "\n"
            ).encode(),
            f"{pad.identifier}_parent.txt": (head + "\n".join(parent) + "\n").encode(),
        }
