"""The words of the field, as tables: relaxation, creep compliance, dynamic stiffness or moduli."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import jax
import numpy as np

from qlvbayes.io.checks import InputError
from qlvbayes.use.exports.card import NO_CONTACT, card, commented
from qlvbayes.use.exports.finite_elements import POISSON, moduli
from qlvbayes.use.exports.pad import Draws, ExportedPad
from qlvbayes.use.exports.target import AbstractTarget, Geometry

_ROWS = 61  # times, and frequencies, evenly in their logarithm
_BAND = (0.05, 0.95)
_STATED = (10.0, 100.0, 1000.0)  # s, at which relaxation is stated in words
_SHEAR = 2.0 * (1.0 + POISSON)  # Young's modulus over the shear modulus


class ViscoelasticCurves(AbstractTarget):
    r"""Curves of small deformation about first contact, with 90 % bands over the draws.

    .. math:: g(t) = c_0 + \sum_i c_i e^{-v_i t}, \quad
              k'(\omega) = k \Big(c_0 + \sum_i \frac{c_i \omega^2}{\omega^2 + v_i^2}\Big), \quad
              k''(\omega) = k \sum_i \frac{c_i \omega v_i}{\omega^2 + v_i^2}, \quad
              \tan\delta = k''/k'

    k: the instantaneous stiffness K(0). The creep compliance J(t), the displacement under one unit
    of force, solves :math:`\int_0^t k\, g(t - s)\, dJ(s) = 1` exactly, by the eigenvalues of
    diag(v) - u u^T, u_i = (c_i v_i)^{1/2}. A cycle of amplitude a loses the energy pi k'' a^2,
    which is given over a^2. Of stress over strain they are the moduli of that deformation; with a
    specimen's shape Young's moduli E' and E'' (and the energy is that of a volume over the squared
    strain), with them G' and G'', which are E' and E'' over 2 (1 + nu). Times and frequencies are
    those tested. Tschoegl 1989, doi:10.1007/978-3-642-73602-5, ch. 2 to 4.
    """

    name = "curves"
    what = "tables (CSV) of relaxation, creep compliance, storage, loss and tan delta, with bands"
    cannot = (NO_CONTACT, "stiffening with depth: this is small deformation about first contact")

    def files(self, pad: ExportedPad, specimen: Geometry | None) -> dict[str, bytes]:
        """Return the content of ``pad_B_relaxation.csv`` and ``pad_B_dynamic.csv``."""
        if pad.covered is None:
            raise InputError(
                f"the results of pad {pad.pad} do not say which rates and times were tested",
                remedy="run qlvbayes fit, or use --to json",
            )
        unit, compliance, scale = _units(pad, specimen)
        time = np.geomspace(pad.covered.quickest, pad.covered.hold, _ROWS)
        frequency = 1.0 / (2.0 * np.pi * time[::-1])

        def stiff(draws: Draws) -> np.ndarray:
            return scale * _stiffness(pad, draws)

        def dynamic(draws: Draws) -> tuple[np.ndarray, np.ndarray]:
            k = stiff(draws)
            storage, loss = dynamic_shares(draws, 2.0 * np.pi * frequency)
            return k * storage, k * loss

        relaxation = {
            ("time", "s"): time,
            **_banded(pad, ("share_left", "1"), lambda x: relaxed(x, time)),
            **_banded(pad, ("creep_compliance", compliance), lambda x: crept(x, time) / stiff(x)),
        }
        dynamics = {
            ("frequency", "Hz"): frequency,
            **_banded(pad, ("storage", unit), lambda x: dynamic(x)[0]),
            **_banded(pad, ("loss", unit), lambda x: dynamic(x)[1]),
            **_banded(pad, ("tan_delta", "1"), lambda x: np.divide(*dynamic(x)[::-1])),
            **_banded(pad, ("lost_in_a_cycle", unit), lambda x: np.pi * dynamic(x)[1]),
        }
        if specimen is not None:
            dynamics |= _banded(pad, ("shear_storage", unit), lambda x: dynamic(x)[0] / _SHEAR)
            dynamics |= _banded(pad, ("shear_loss", unit), lambda x: dynamic(x)[1] / _SHEAR)
        head = commented([*card(pad, type(self)), *_stated(pad, pad.covered.hold)], "#")
        return {
            f"{pad.identifier}_relaxation.csv": _table(head, relaxation),
            f"{pad.identifier}_dynamic.csv": _table(head, dynamics),
        }


def _stated(pad: ExportedPad, hold: float) -> list[str]:
    """Return the share left after a jump and a decade of times, where it was held so long."""
    lines = []
    for time in _STATED:
        ends = _banded(pad, ("", ""), partial(relaxed, time=np.array([time])))
        middle, low, high = (float(values[0]) for values in ends.values())
        interval = f"{middle:.4g} ({low:.4g} to {high:.4g})"
        lines.append(
            f"Share left {time:g} s after a jump: "
            + (
                interval
                if time <= hold
                else f"not stated: held to {hold:.4g} s, do not extrapolate"
            )
        )
    return lines


def relaxed(draws: Draws, time: np.ndarray) -> np.ndarray:
    """Return the relaxation g (n, T) at times (s)."""
    decays = np.exp(-draws.rates[:, :, None] * time)
    return draws.fractions[:, :1] + np.einsum("nk,nkt->nt", draws.fractions[:, 1:], decays)


def crept(draws: Draws, time: np.ndarray) -> np.ndarray:
    """Return the creep compliance J (n, T) at times (s), times the instantaneous stiffness."""
    u = np.sqrt(draws.fractions[:, 1:] * draws.rates)
    matrix = draws.rates[:, :, None] * np.eye(u.shape[1]) - u[:, :, None] * u[:, None, :]
    rates, vectors = np.linalg.eigh(matrix)
    weights = np.einsum("nik,ni->nk", vectors, u) ** 2
    passed = np.maximum(rates, 0.0)[:, :, None] * time
    # (1 - e^{-r t})/r, which is t where nothing holds the specimen in the end
    grown = -np.expm1(-passed) / np.where(passed > 0.0, passed, 1.0)
    grown = time * np.where(passed > 0.0, grown, 1.0)
    return 1.0 + np.einsum("nk,nkt->nt", weights, grown)


def dynamic_shares(draws: Draws, omega: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return storage and loss (n, W) at angular frequencies (1/s), over K(0)."""
    ratio = draws.rates[:, :, None] / omega
    shares = draws.fractions[:, 1:, None] / (1.0 + ratio**2)
    return draws.fractions[:, :1] + np.sum(shares, axis=1), np.sum(shares * ratio, axis=1)


def _stiffness(pad: ExportedPad, draws: Draws) -> np.ndarray:
    """Return the instantaneous stiffness K(0) of each draw, (n, 1)."""
    constants = dict(zip(pad.elastic.units, draws.elastic.T, strict=True))
    laws = replace(pad.elastic, **constants)  # what is fixed, as a spline's depth, stays
    stiffness = jax.vmap(lambda law: law.stiffness(jax.numpy.asarray(0.0)))(laws)
    return np.asarray(stiffness)[:, None]


def _units(pad: ExportedPad, specimen: Geometry | None) -> tuple[str, str, float]:
    """Return units of stiffness and compliance, and the factor of the pad's own stiffness."""
    if specimen is None and not pad.units.dimensionless:
        if pad.stiffness(0.0) == 0.0:
            raise InputError(
                f"the elastic law {type(pad.elastic).name} has no stiffness at first contact",
                remedy="use --to json",
            )
        return pad.units.of("stiffness"), pad.units.of("compliance"), 1.0
    return "MPa", "1/MPa", moduli(pad, specimen).young / pad.stiffness(0.0)


def _banded(
    pad: ExportedPad, column: tuple[str, str], curve: Callable[[Draws], np.ndarray]
) -> dict[tuple[str, str], np.ndarray]:
    """Return the middle draw's curve and the ends of the band, by name and unit."""
    name, unit = column
    low, high = np.quantile(curve(pad.table), _BAND, axis=0)
    return {column: curve(pad.middle)[0], (f"{name}_low", unit): low, (f"{name}_high", unit): high}


def _table(head: str, columns: dict[tuple[str, str], np.ndarray]) -> bytes:
    names = ",".join(name if unit == "1" else f"{name} ({unit})" for name, unit in columns)
    rows = zip(*(values.tolist() for values in columns.values()), strict=True)
    text = "".join(",".join(map(repr, row)) + "\n" for row in rows)
    return f"{head}{names}\n{text}".encode()
