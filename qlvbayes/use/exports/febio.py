"""A material block for FEBio."""

from __future__ import annotations

import math

from qlvbayes.io.checks import InputError
from qlvbayes.laws.relaxation.continuous import Fung, PowerLaw
from qlvbayes.use.exports.card import card, in_comment, template
from qlvbayes.use.exports.material import CANNOT, POISSON, moduli, structure, terms
from qlvbayes.use.exports.pad import ExportedPad
from qlvbayes.use.exports.target import AbstractTarget, Geometry

_MOST = 6  # modes of FEBio's viscoelastic


class FEBio(AbstractTarget):
    r"""``viscoelastic`` with g0 written, or a reactive one where the spectrum is continuous.

    .. math:: g(t) = g_0 + \sum_{i=1}^{6} g_i e^{-t/t_i}

    FEBio takes g0 = 1 where it is not written, which would give far too much long-term force.
    Fung's box is its ``relaxation-Malkin`` at beta = 1, (1 + t/tau)^-alpha its
    ``relaxation-power``; both fall to zero, so that the share that stays is an elastic solid in
    parallel with the bonds that relax.
    """

    name = "febio"
    what = "a <material> of type viscoelastic, or reactive viscoelastic (N, mm, s, MPa)"
    cannot = CANNOT

    def files(self, pad: ExportedPad, specimen: Geometry | None) -> dict[str, bytes]:
        """Return the content of ``pad_B.feb``, whose material goes into a model."""
        young = moduli(pad, specimen).young
        law = pad.relaxation
        if isinstance(law, Fung):
            ends = sorted((float(law.tau1), float(law.tau2)))
            width = float(law.c) * math.log(ends[1] / ends[0])
            stays = 1.0 / (1.0 + width)
            kind = {"type": "relaxation-Malkin", "tau1": ends[0], "tau2": ends[1], "beta": 1.0}
        elif isinstance(law, PowerLaw):
            stays = float(law.c0)
            kind = {"type": "relaxation-power", "tau": float(law.tau), "beta": float(law.alpha)}
        elif pad.times.size <= _MOST:
            stays, kind = float(pad.fractions[0]), {}
        else:
            raise InputError(
                f"FEBio has no relaxation like {pad.choices.relaxing}, "
                f"and takes {_MOST} modes at most",
                remedy="fit with --relaxation prony:3, fung or power-law",
            )
        text = template(
            "pad.feb.j2",
            name=pad.identifier,
            card=in_comment(card(pad, type(self), structure(pad))),
            young=young,
            poisson=POISSON,
            stays=stays,
            relaxation=kind,
            modes=terms(pad),
        )
        return {f"{pad.identifier}.feb": text.encode()}
