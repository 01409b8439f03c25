"""Commands of a viscoelastic material for Ansys Mechanical APDL."""

from __future__ import annotations

from qlvbayes.use.exports.material import POISSON, AbstractDeck, Moduli, terms
from qlvbayes.use.exports.pad import ExportedPad

_CONSTANTS = 6  # that one TBDATA takes
_MATERIAL = 1  # its number


class Ansys(AbstractDeck):
    r"""``TB,PRONY`` of the shear modulus; the elastic constants are those of the fast limit.

    .. math:: G(t) = G_0 (\alpha_\infty + \sum_i \alpha_i e^{-t/\tau_i}), \qquad \alpha_i = c_i

    The bulk modulus does not relax.
    """

    name = "ansys"
    what = "MP,EX and TB,PRONY,1,1,N,SHEAR with TBDATA (N, mm, s, MPa)"
    mark = "!"

    def lines(self, pad: ExportedPad, modulus: Moduli) -> dict[str, list[str]]:
        """Return the lines of ``pad_B.mac``."""
        numbers = [repr(x) for term in terms(pad) for x in term]
        lines = [
            f"MP,EX,{_MATERIAL},{modulus.young!r}",
            f"MP,PRXY,{_MATERIAL},{POISSON}",
            f"TB,PRONY,{_MATERIAL},1,{pad.times.size},SHEAR",
        ]
        lines += [
            f"TBDATA,{first + 1},{','.join(numbers[first : first + _CONSTANTS])}"
            for first in range(0, len(numbers), _CONSTANTS)
        ]
        return {".mac": lines}
