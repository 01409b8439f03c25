"""Blocks of a viscoelastic material for OpenRadioss."""

from __future__ import annotations

from qlvbayes.io.checks import InputError
from qlvbayes.use.exports.material import DENSITY, FEWER_TERMS, AbstractDeck, Moduli, field
from qlvbayes.use.exports.pad import ExportedPad

_MOST = 100  # terms of /VISC/PRONY


class OpenRadioss(AbstractDeck):
    r"""``/MAT/LAW42``, one Ogden pair of exponent 2 (neo-Hooke), with ``/VISC/PRONY`` on it.

    .. math:: G(t) = \mu_1 + \sum_i G_i e^{-\beta_i t}, \qquad
              \mu_1 = c_0 G, \quad G_i = c_i G, \quad \beta_i = v_i

    Ogden's moduli are those of the slow limit, on which the Prony series is set. Poisson's ratio is
    written such that the bulk modulus of the slow limit is that of the fast one. Fields have 20
    columns, which hold 15 digits or more.
    """

    name = "radioss"
    what = "/MAT/LAW42 with /VISC/PRONY, for OpenRadioss (N, mm, s, MPa, t)"
    mark = "#"

    def lines(self, pad: ExportedPad, modulus: Moduli) -> dict[str, list[str]]:
        """Return the lines of ``pad_B.rad``.

        Raises InputError where nothing stays, or there are too many terms.
        """
        shear = modulus.shear * float(pad.fractions[0])
        if shear <= 0.0 or pad.times.size > _MOST:
            raise InputError(
                f"OpenRadioss takes {_MOST} terms at most in addition to a modulus that stays",
                remedy=FEWER_TERMS,
            )
        bulk = modulus.bulk
        poisson = (3.0 * bulk - 2.0 * shear) / (2.0 * (3.0 * bulk + shear))
        rows = zip(pad.fractions[1:].tolist(), pad.middle.rates[0].tolist(), strict=True)
        lines = [
            "/MAT/LAW42/1",
            pad.identifier,
            f"#              RHO_I, t/mm3 ({DENSITY:g}: water's, of which tests say nothing)",
            field(DENSITY),
            "#                 Nu           sigma_cut           funIDbulk         Fscale_bulk"
            "         M    I_form",
            f"{field(poisson)}{'':60}{0:>10d}{0:>10d}",
            "#               Mu_1",
            field(shear),
            "",
            "#            alpha_1",
            field(2.0),
            "",
            "/VISC/PRONY/1",
            "#        M                           K_v      Itab    Ishape",
            f"{pad.times.size:>10d}{'':10}{field(0.0)}{0:>10d}{0:>10d}",
            "#                G_i              Beta_i                  Ki             Beta_ki",
            *(f"{field(modulus.shear * g)}{field(v)}{2 * field(0.0)}" for g, v in rows),
        ]
        return {".rad": lines}
