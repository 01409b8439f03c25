"""A keyword of a viscoelastic material for LS-DYNA."""

from __future__ import annotations

from qlvbayes.io.checks import InputError
from qlvbayes.use.exports.card import card, commented
from qlvbayes.use.exports.material import CANNOT, DENSITY, POISSON, column, moduli, structure
from qlvbayes.use.exports.pad import ExportedPad
from qlvbayes.use.exports.target import AbstractTarget, Geometry

_WIDTH = 20  # of a field in the long format
_MOST = 18  # terms that the keyword takes


class LSDyna(AbstractTarget):
    r"""``*MAT_GENERAL_VISCOELASTIC`` (76) in the long format, whose fields hold 15 digits or more.

    .. math:: G(t) = \sum_i G_i e^{-\beta_i t}, \qquad G_0 = c_0 G, \beta_0 = 0

    What never relaxes is a term without decay. The bulk modulus does not relax.
    """

    name = "ls-dyna"
    what = "*MAT_GENERAL_VISCOELASTIC, long format (N, mm, s, MPa, t)"
    cannot = CANNOT

    def files(self, pad: ExportedPad, specimen: Geometry | None) -> dict[str, bytes]:
        """Return the content of ``pad_B.k``.

        Raises InputError where there are more than 18 terms.
        """
        modulus = moduli(pad, specimen)
        if pad.fractions.size > _MOST:
            raise InputError(
                f"LS-DYNA takes {_MOST} terms at most, and {pad.choices.relaxing} has "
                f"{pad.fractions.size}",
                remedy="fit with --relaxation prony:3",
            )
        rates = [0.0, *pad.middle.rates[0].tolist()]
        terms = zip((modulus.shear * pad.fractions).tolist(), rates, strict=True)
        lines = [
            "*MAT_GENERAL_VISCOELASTIC_TITLE +",
            pad.identifier,
            f"$ mid, density (t/mm3; {DENSITY:g} is water's, of which tests say nothing), bulk",
            f"{1:>{_WIDTH}d}{_field(DENSITY)}{_field(modulus.bulk)}",
            "$ no curves: the terms follow",
            "".join(f"{0:>{_WIDTH}d}" for _ in range(2)),
            f"$ shear modulus, decay (1/s), of Poisson's ratio {POISSON} in the fast limit",
            *(f"{_field(g)}{_field(rate)}" for g, rate in terms),
        ]
        head = commented(card(pad, type(self), structure(pad)), "$")
        return {f"{pad.identifier}.k": (head + "\n".join(lines) + "\n").encode()}


def _field(value: float) -> str:
    """Return a field that begins with a blank, so that the eye separates it from the last."""
    return column(value, _WIDTH - 1).rjust(_WIDTH)
