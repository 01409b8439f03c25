"""A plain table of a material's Prony series, for programs that have no export of their own."""

from __future__ import annotations

import json

from qlvbayes.use.exports.card import card, commented
from qlvbayes.use.exports.material import CANNOT, POISSON, moduli, structure, terms
from qlvbayes.use.exports.pad import ExportedPad
from qlvbayes.use.exports.target import AbstractTarget, Geometry

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
            "pad": pad.name,
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
