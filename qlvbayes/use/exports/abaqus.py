"""Keyword lines of a viscoelastic material for Abaqus."""

from __future__ import annotations

from qlvbayes.use.exports.card import card, commented
from qlvbayes.use.exports.material import CANNOT, POISSON, moduli, structure, terms
from qlvbayes.use.exports.pad import ExportedPad
from qlvbayes.use.exports.target import AbstractTarget, Geometry


class Abaqus(AbstractTarget):
    r"""``*VISCOELASTIC, TIME=PRONY`` on constants of the fast limit.

    .. math:: G(t) = G_0 (1 - \sum_i g_i (1 - e^{-t/\tau_i})), \qquad g_i = c_i, \tau_i = 1/v_i

    The bulk modulus does not relax (k = 0), so that E(t)/E(0) is g(t) to (1 - 2 nu)/3 of what
    relaxes.
    """

    name = "abaqus"
    what = "*ELASTIC or *HYPERELASTIC with *VISCOELASTIC, TIME=PRONY (N, mm, s, MPa)"
    cannot = CANNOT

    def files(self, pad: ExportedPad, specimen: Geometry | None) -> dict[str, bytes]:
        """Return the content of ``pad_B.inp``, the card on top."""
        modulus = moduli(pad, specimen)
        lines = [f"*MATERIAL, NAME={pad.identifier.upper()}"]
        if type(pad.elastic).name == "linear":
            lines += ["*ELASTIC, MODULI=INSTANTANEOUS", f"{modulus.young!r}, {POISSON}"]
        else:
            # C10 = G/2, D1 = 2/K
            lines += ["*HYPERELASTIC, NEO HOOKE, MODULI=INSTANTANEOUS"]
            lines += [f"{modulus.shear / 2.0!r}, {2.0 / modulus.bulk!r}"]
        lines += ["*VISCOELASTIC, TIME=PRONY", "** g, k, tau"]
        lines += [f"{g!r}, 0.0, {tau!r}" for g, tau in terms(pad)]
        head = commented(card(pad, type(self), structure(pad)), "**")
        return {f"{pad.identifier}.inp": (head + "\n".join(lines) + "\n").encode()}
