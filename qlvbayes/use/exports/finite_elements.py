"""A pad's constants as those of a material for finite elements: Abaqus, FEBio and a plain table."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass

from qlvbayes.io.checks import InputError
from qlvbayes.io.units import PAD, STRAIN
from qlvbayes.laws.relaxation.continuous import Fung, PowerLaw
from qlvbayes.use.exports.card import NO_CONTACT, ONE_DRAW, card, commented, in_comment, template
from qlvbayes.use.exports.pad import ExportedPad
from qlvbayes.use.exports.target import AbstractTarget, Geometry

POISSON = 0.495  # wet soft solids hardly change volume; what ordinary elements still solve
_MPA = 1e-3  # of a kPa

CANNOT = (
    NO_CONTACT,
    "stiffening with depth: the modulus is that of small strain",
    f"the volume's own stiffness, which tests do not give: Poisson's ratio {POISSON} is assumed",
    ONE_DRAW,
)
STRUCTURE = (
    "the shape: shares g and times apply to a material only for a homogeneous specimen; a "
    "fluid-filled pad is a structure, whose fluid takes part in what relaxes"
)


@dataclass(frozen=True)
class Moduli:
    """Elastic moduli of the fast limit, at small strain, in MPa (N/mm2)."""

    young: float

    @property
    def shear(self) -> float:
        """G = E/(2 (1 + nu))."""
        return self.young / (2.0 * (1.0 + POISSON))

    @property
    def bulk(self) -> float:
        """K = E/(3 (1 - 2 nu))."""
        return self.young / (3.0 * (1.0 - 2.0 * POISSON))


def moduli(pad: ExportedPad, specimen: Geometry | None) -> Moduli:
    """Return E: K(0) of stress over strain, or K(0) height/area of force over displacement."""
    stiffness = pad.stiffness(0.0)
    if stiffness == 0.0:
        raise InputError(
            f"the elastic law {type(pad.elastic).name} has no stiffness at first contact, hence no "
            "modulus",
            remedy="use --to c, fmu or json",
        )
    if pad.units.dimensionless:
        return Moduli(stiffness * _MPA * pad.units.factor_to(STRAIN, "stiffness"))
    if specimen is None:
        raise InputError(
            f"pad {pad.pad} has force over displacement, and a modulus needs its shape",
            remedy="give --height MM and --area MM2 of a homogeneous specimen",
        )
    return Moduli(
        stiffness * pad.units.factor_to(PAD, "stiffness") * specimen.height / specimen.area
    )


def structure(pad: ExportedPad) -> tuple[str, ...]:
    """Return the limits that a card states in addition to ``CANNOT``."""
    return () if pad.units.dimensionless else (STRUCTURE,)


def terms(pad: ExportedPad) -> list[tuple[float, float]]:
    """Return share and time (s) of each term that relaxes."""
    return list(zip(pad.fractions[1:].tolist(), pad.times.tolist(), strict=True))


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


_PASCAL = 1e6  # of a MPa


class PronyTable(AbstractTarget):
    r"""Shares, shear moduli, bulk moduli and times of a generalized Maxwell model, in SI units.

    .. math:: G(t) = \sum_i G_i e^{-t/\tau_i}, \quad K(t) = \sum_i K_i e^{-t/\tau_i}, \qquad
              G_i = g_i G(0), \quad \tau_0 = \infty

    The first row is what never relaxes. The bulk modulus does not relax, so that it is in the first
    row alone.
    """

    name = "prony"
    what = "a table (CSV, JSON) of g, G (Pa), K (Pa) and tau (s), what never relaxes first"
    cannot = CANNOT

    def files(self, pad: ExportedPad, specimen: Geometry | None) -> dict[str, bytes]:
        """Return the content of ``pad_B_prony.csv`` and ``pad_B_prony.json``."""
        modulus = moduli(pad, specimen)
        young, shear, bulk = (_PASCAL * x for x in (modulus.young, modulus.shear, modulus.bulk))
        stays = float(pad.fractions[0])
        rows: list[tuple[float | None, ...]] = [(stays, stays * shear, bulk, None)]
        rows += [(g, g * shear, 0.0, tau) for g, tau in terms(pad)]
        said = card(pad, type(self), structure(pad))
        content = {
            "schema": 1,
            "pad": pad.pad,
            "date": pad.date,
            "card": said,
            "fast_limit": {"E_Pa": young, "G_Pa": shear, "K_Pa": bulk, "poisson": POISSON},
            "terms": [dict(zip(("g", "G_Pa", "K_Pa", "tau_s"), row, strict=True)) for row in rows],
        }
        limit = f"Fast limit: E = {young!r} Pa, G = {shear!r} Pa, K = {bulk!r} Pa"
        lines = [",".join("inf" if x is None else repr(x) for x in row) for row in rows]
        table = "\n".join(["g,G (Pa),K (Pa),tau (s)", *lines, ""])
        return {
            f"{pad.identifier}_prony.csv": (commented([*said, limit], "#") + table).encode(),
            f"{pad.identifier}_prony.json": (json.dumps(content, allow_nan=False) + "\n").encode(),
        }
