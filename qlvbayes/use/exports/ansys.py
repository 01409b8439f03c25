"""Commands of a viscoelastic material for Ansys Mechanical APDL."""

from __future__ import annotations

from qlvbayes.use.exports.card import card, commented
from qlvbayes.use.exports.material import CANNOT, POISSON, moduli, structure
from qlvbayes.use.exports.pad import ExportedPad
from qlvbayes.use.exports.target import AbstractTarget, Geometry

_CONSTANTS = 6  # that one TBDATA takes
_MATERIAL = 1  # its number


class Ansys(AbstractTarget):
    r"""``TB,PRONY`` of the shear modulus; the elastic constants are those of the fast limit.

    .. math:: G(t) = G_0 (\alpha_\infty + \sum_i \alpha_i e^{-t/\tau_i}), \qquad \alpha_i = c_i

    The bulk modulus does not relax.
    """

    name = "ansys"
    what = "MP,EX and TB,PRONY,1,1,N,SHEAR with TBDATA (N, mm, s, MPa)"
    cannot = CANNOT

    def files(self, pad: ExportedPad, specimen: Geometry | None) -> dict[str, bytes]:
        """Return the content of ``pad_B.mac``."""
        modulus = moduli(pad, specimen)
        head = commented(card(pad, type(self), structure(pad)), "!")
        pairs = zip(pad.fractions[1:].tolist(), pad.times.tolist(), strict=True)
        terms = [repr(x) for pair in pairs for x in pair]
        lines = [
            f"MP,EX,{_MATERIAL},{modulus.young!r}",
            f"MP,PRXY,{_MATERIAL},{POISSON}",
            f"TB,PRONY,{_MATERIAL},1,{pad.times.size},SHEAR",
        ]
        lines += [
            f"TBDATA,{first + 1},{','.join(terms[first : first + _CONSTANTS])}"
            for first in range(0, len(terms), _CONSTANTS)
        ]
        return {f"{pad.identifier}.mac": (head + "\n".join(lines) + "\n").encode()}
