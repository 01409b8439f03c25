"""Branches of a generalized Maxwell model for COMSOL Multiphysics."""

from __future__ import annotations

from qlvbayes.use.exports.material import POISSON, AbstractDeck, Moduli, terms
from qlvbayes.use.exports.pad import ExportedPad

_PASCAL = 1e6  # of a MPa


class Comsol(AbstractDeck):
    r"""Three columns for the table of branches, and the moduli of the parent material.

    .. math:: G(t) = G + \sum_m G_m e^{-t/\tau_m}, \qquad G = c_0 G_0, \quad G_m = c_m G_0

    The parent's moduli are long-term, as COMSOL takes them by default.
    """

    name = "comsol"
    what = "a table of branch, shear modulus (Pa) and time (s), with the long-term parent"
    mark = "%"

    def lines(self, pad: ExportedPad, modulus: Moduli) -> dict[str, list[str]]:
        """Return the lines of ``pad_B_branches.txt`` and ``pad_B_parent.txt`` (parameters)."""
        shear = _PASCAL * modulus.shear
        branches = [f"{m} {shear * g!r} {tau!r}" for m, (g, tau) in enumerate(terms(pad), 1)]
        parent = [
            f'G_long {shear * float(pad.fractions[0])!r}[Pa] "shear modulus, long-term"',
            f'K_bulk {_PASCAL * modulus.bulk!r}[Pa] "bulk modulus, Poisson ratio {POISSON} fast"',
        ]
        columns = "% branch, shear modulus (Pa), relaxation time (s)"
        return {"_branches.txt": [columns, *branches], "_parent.txt": parent}
