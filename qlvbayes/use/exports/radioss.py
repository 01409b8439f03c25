"""Blocks of a viscoelastic material for OpenRadioss."""

from __future__ import annotations

from qlvbayes.io.checks import InputError
from qlvbayes.use.exports.card import card, commented
from qlvbayes.use.exports.material import CANNOT, DENSITY, column, moduli, structure
from qlvbayes.use.exports.pad import ExportedPad
from qlvbayes.use.exports.target import AbstractTarget, Geometry

_WIDTH = 20
_MOST = 100  # terms of /VISC/PRONY


class OpenRadioss(AbstractTarget):
    r"""``/MAT/LAW42``, one Ogden pair of exponent 2 (neo-Hooke), with ``/VISC/PRONY`` on it.

    .. math:: G(t) = \mu_1 + \sum_i G_i e^{-\beta_i t}, \qquad
              \mu_1 = c_0 G, \quad G_i = c_i G, \quad \beta_i = v_i

    Ogden's moduli are those of the slow limit, on which the Prony series is set. Poisson's ratio is
    written such that the bulk modulus of the slow limit is that of the fast one. Fields have 20
    columns, which hold 15 digits or more.
    """

    name = "radioss"
    what = "/MAT/LAW42 with /VISC/PRONY, for OpenRadioss (N, mm, s, MPa, t)"
    cannot = CANNOT

    def files(self, pad: ExportedPad, specimen: Geometry | None) -> dict[str, bytes]:
        """Return the content of ``pad_B.rad``.

        Raises InputError where nothing stays, or there are too many terms.
        """
        modulus = moduli(pad, specimen)
        shear = modulus.shear * float(pad.fractions[0])
        if shear <= 0.0 or pad.times.size > _MOST:
            raise InputError(
                f"OpenRadioss takes {_MOST} terms at most in addition to a modulus that stays",
                remedy="fit with --relaxation prony:3",
            )
        bulk = modulus.bulk
        poisson = (3.0 * bulk - 2.0 * shear) / (2.0 * (3.0 * bulk + shear))
        rows = zip(
            (modulus.shear * pad.fractions[1:]).tolist(), pad.middle.rates[0].tolist(), strict=True
        )
        blank = " " * _WIDTH
        lines = [
            "/MAT/LAW42/1",
            pad.identifier,
            f"#              RHO_I, t/mm3 ({DENSITY:g}: water's, of which tests say nothing)",
            _field(DENSITY),
            "#                 Nu           sigma_cut           funIDbulk         Fscale_bulk"
            "         M    I_form",
            _field(poisson) + 3 * blank + f"{0:>10d}{0:>10d}",
            "#               Mu_1",
            _field(shear),
            "",
            "#            alpha_1",
            _field(2.0),
            "",
            "/VISC/PRONY/1",
            "#        M                           K_v      Itab    Ishape",
            f"{pad.times.size:>10d}{'':10}{_field(0.0)}{0:>10d}{0:>10d}",
            "#                G_i              Beta_i                  Ki             Beta_ki",
            *(f"{_field(g)}{_field(v)}{2 * _field(0.0)}" for g, v in rows),
        ]
        head = commented(card(pad, type(self), structure(pad)), "#")
        return {f"{pad.identifier}.rad": (head + "\n".join(lines) + "\n").encode()}


def _field(value: float) -> str:
    """Return a field that begins with a blank, so that the eye separates it from the last."""
    return column(value, _WIDTH - 1).rjust(_WIDTH)
