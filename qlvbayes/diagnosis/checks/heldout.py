"""Errors on tests left out: what a hypothesis predicts of each test from all the others.

Where there is only one test, its phases are left out, one after another. What was left out has no
part in the fit, which starts from the mode on all tests, nor in the size of the discrepancy.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from qlvbayes.diagnosis.checks.samples import Mask, Samples, rmse
from qlvbayes.inference.density import Density
from qlvbayes.inference.modes import Mode, find_mode
from qlvbayes.io.arrays import Array


class HeldOutPart(NamedTuple):
    """Part of the data that is left out of a fit, to be predicted by it."""

    density: Density  # posterior density on everything else
    test: int  # index of the test that the part belongs to
    rows: Mask  # which of the test's samples it holds


class HeldOut(NamedTuple):
    """A part as it is predicted by a fit to everything else."""

    residual: Array  # (n,): measured minus predicted force (N)
    sds: Array  # (n,): stated sds of the samples over the floor's
    constants: Array  # (P,): by the fit


def leave_out(density: Density, samples: Samples) -> list[HeldOutPart]:
    """Return each test as a part to be left out, or each phase where there is only one test."""
    return [HeldOutPart(density.without(out), k, rows) for out, k, rows in samples.left_out()]


def predicted(samples: Samples, parts: Sequence[HeldOutPart], mode: Mode) -> list[HeldOut]:
    """Return what a hypothesis predicts of each part, fitted from its mode on all tests."""
    hypothesis, found = mode.point.own.hypothesis, []
    for density, k, rows in parts:
        own = find_mode(density, hypothesis, mode.point.theta, guess=mode.size) or mode
        own.point.separation.forget()  # of nine long tests, all left out would take a gigabyte
        residual = samples.residuals(density, own)[k][rows]
        found.append(HeldOut(residual, samples.weights[k][rows], own.point.constants))
    return found


def error(parts: Sequence[HeldOut]) -> float:
    """Return the root mean square error (N) over some parts, weighted by the stated sds.

    It is nan of no part, as where there is only one test with one phase.
    """
    if not parts:
        return math.nan
    return rmse([one.residual for one in parts], [one.sds for one in parts])
