"""A keyword of a viscoelastic material for LS-DYNA."""

from __future__ import annotations

from qlvbayes.use.exports.material import DENSITY, POISSON, AbstractDeck, Moduli, field
from qlvbayes.use.exports.pad import ExportedPad


class LSDyna(AbstractDeck):
    r"""``*MAT_GENERAL_VISCOELASTIC`` (76) in the long format, whose fields hold 15 digits or more.

    .. math:: G(t) = \sum_i G_i e^{-\beta_i t}, \qquad G_0 = c_0 G, \beta_0 = 0

    What never relaxes is a term without decay. The bulk modulus does not relax.
    """

    name = "ls-dyna"
    what = "*MAT_GENERAL_VISCOELASTIC, long format (N, mm, s, MPa, t)"
    mark = "$"
    most = 18  # terms that the keyword takes
    long_term = True
    room = f"LS-DYNA takes {most} terms at most"

    def lines(self, pad: ExportedPad, modulus: Moduli) -> dict[str, list[str]]:
        """Return the lines of ``pad_B.k``."""
        rates = [0.0, *pad.middle.rates[0].tolist()]
        rows = zip(pad.fractions.tolist(), rates, strict=True)
        lines = [
            "*MAT_GENERAL_VISCOELASTIC_TITLE +",
            pad.identifier,
            f"$ mid, density (t/mm3; {DENSITY:g} is water's, of which tests say nothing), bulk",
            f"{1:>20d}{field(DENSITY)}{field(modulus.bulk)}",
            "$ no curves: the terms follow",
            2 * f"{0:>20d}",
            f"$ shear modulus, decay (1/s), of Poisson's ratio {POISSON} in the fast limit",
            *(f"{field(modulus.shear * g)}{field(rate)}" for g, rate in rows),
        ]
        return {".k": lines}
