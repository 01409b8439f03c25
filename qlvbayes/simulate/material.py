"""The pad's force as differential equations, solved by a stiff integrator."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from qlvbayes.io.checks import InputError

from .constants import Constants
from .motion import Motion, Piece

_RTOL = 1e-10  # of the ODE solver
_ATOL = 1e-12  # N: far below any noise


class Material(Protocol):
    """Anything that answers a platen's motion with a force."""

    def force(self, platen: Motion, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the force (N, compression positive) at ascending `times` (s) of the program."""
        ...


@dataclass(frozen=True)
class Pad:
    """The quasi-linear viscoelastic pad of the paper's Eq. 6, as ordinary differential equations.

    q_i' = -v_i q_i + K(d) d',  K = m e^{b d},  q_i(0) = 0
    F = c0 m/b (e^{b d} - 1) + sum c_i q_i

    A pad that is not `bonded` cannot pull: its force is max(F, 0).
    """

    constants: Constants
    bonded: bool = False

    def force(self, platen: Motion, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the force (N) at ascending `times` (s); right to 1e-8 of the peak."""
        check_times(platen, times)
        c = np.array(self.constants.c)
        elastic = self.constants.force(platen.displacement(times))
        force = c[0] * elastic + c[1:] @ _overstress(self.constants, platen, times)
        return force if self.bonded else np.maximum(force, 0.0)


def check_times(platen: Motion, times: NDArray[np.float64]) -> None:
    """Refuse times that do not ascend or that leave the program."""
    if np.any(np.diff(times) < 0):
        raise InputError("the times of a simulation must ascend")
    if times.size and not (times[0] >= 0 and times[-1] <= platen.duration * (1 + 1e-12)):
        raise InputError(f"the times of a simulation must lie in 0 to {platen.duration:g} s")


def _overstress(
    constants: Constants, platen: Motion, times: NDArray[np.float64]
) -> NDArray[np.float64]:
    """q_i at the times, shape (r, n); each piece on its own, as the solver needs smoothness."""
    q = np.zeros((len(constants.v), times.size))
    if not constants.v:
        return q
    state = np.zeros(len(constants.v))
    edges = np.searchsorted(times, [p.start for p in platen.pieces[1:]])
    for piece, wanted in zip(platen.pieces, np.split(np.arange(times.size), edges), strict=True):
        q[:, wanted], state = _cross(constants, piece, state, times[wanted] - piece.start)
    return q


def _cross(
    constants: Constants, piece: Piece, state: NDArray[np.float64], tau: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Solve over one piece: q at its local times `tau`, and q at its end."""
    v = np.array(constants.v)
    jacobian = np.diag(-v)
    m, b = constants.m, constants.b
    d0, v0, a = piece.displacement, piece.velocity, piece.acceleration

    def slope(t: float, q: NDArray[np.float64]) -> NDArray[np.float64]:
        d = d0 + t * (v0 + 0.5 * a * t)
        return m * exp(b * d) * (v0 + a * t) - v * q

    solution = solve_ivp(
        slope,
        (0.0, piece.duration),
        state,
        method="LSODA",
        dense_output=True,
        jac=lambda t, q: jacobian,
        rtol=_RTOL,
        atol=_ATOL,
    )
    if not solution.success or solution.sol is None:
        raise RuntimeError(f"the simulation stopped: {solution.message}")
    # The end rides along: the solver's interpolant cannot be asked for no time at all.
    q = solution.sol(np.append(np.clip(tau, 0.0, piece.duration), piece.duration))
    return q[:, :-1], q[:, -1]
