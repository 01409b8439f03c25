"""A pad with hidden effects: its differential equations on a mesh of short cells of time."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..material import check_times
from ..motion import Motion, Piece
from .effect import CONTACT, FRAME, Effect
from .mesh import Array, Mesh, Path, graded

_ROUNDS = 200  # at most, of the balance between force and what gives way
_SEARCHES = 2  # on a coarser mesh, for where the mesh must be fine
_COARSER = 4  # times, that mesh
_OFF_MM = 0.01  # farther off the surface a loose pad stays behind; a hold's creep is less


class QuasiLinear(Protocol):
    """Constants of a quasi-linear law, as `Constants` and others have them."""

    @property
    def c(self) -> tuple[float, ...]:
        """Shares (c0, c1, ...) of the relaxation, sum 1."""

    @property
    def v(self) -> tuple[float, ...]:
        """Its rates (v1, ...), 1/s."""

    def force(self, depth: Array) -> Array:
        """Return the force (N) of an infinitely fast test to `depth` (mm)."""

    def stiffness(self, depth: Array) -> Array:
        """Return the slope of that force (N/mm)."""


@dataclass(frozen=True)
class HiddenPad:
    """A quasi-linear pad with any number of hidden effects.

    w_i' = v_i (F_e(d) - w_i), w_i(0) = F_e(d(0)),  F = c0 F_e + sum c_i (F_e - w_i)

    which is the pad's law with q_i = F_e - w_i, and needs no velocity. The effects change the
    depth on its way in and the force on its way out, always in the same order of nesting.

    Every state obeys a linear equation along a known depth, solved by Radau IIA in cells that
    are fine where the motion or the contact changes. A frame that yields makes the depth unknown;
    then depth and force are iterated along the whole test until they agree.

    Parameters
    ----------
    constants : of the quasi-linear law
    effects : in any order
    bonded : the pad can pull
    cells : of time, in each stretch of constant acceleration
    frame_speed : where the frame yields by y(F), the pad's velocity is V / (1 + y'(F) K(d)), that
        of an elastic pad of stiffness K, in place of the platen's V
    settled : change of the frame's yielding at which frame and pad agree, as a share of the stroke
    """

    constants: QuasiLinear
    effects: tuple[Effect, ...] = ()
    bonded: bool = False
    cells: int = 600
    frame_speed: bool = False
    settled: float = 1e-10

    def force(self, platen: Motion, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Force (N) at ascending `times` (s); continuous from the right where it jumps.

        Raises
        ------
        InputError
            The times are not ascending or leave the program.
        """
        check_times(platen, times)
        late = sum(effect.late() for effect in self._nested)
        seen = np.clip(times - late, 0.0, platen.duration)
        breaks = _breaks(platen, self._levels(platen))
        path, force, mesh = self._settled(platen, breaks, seen)
        for effect in self._nested:
            if effect.order > FRAME:
                force = effect.on_force(force, path)
        return mesh.at(force, seen)

    @cached_property
    def _nested(self) -> list[Effect]:
        return sorted(self.effects, key=lambda effect: effect.order)

    @cached_property
    def _modes(self) -> tuple[Array, Array]:
        shares, rates = np.array(self.constants.c), np.array(self.constants.v)
        for effect in self._nested:
            shares, rates = effect.modes(shares, rates)
        return shares, rates

    def _levels(self, platen: Motion) -> Array:
        """Return the displacements at which the depth or its effects may have a kink."""
        ends = platen.displacement([p.start + p.duration for p in platen.pieces])
        largest = np.unique(np.maximum.accumulate(np.maximum(ends, 0.0)))
        levels, lost = [np.zeros(1), largest], 0.0
        for effect in reversed(self._nested):
            levels.append(effect.kinks(largest - lost) + lost)
            lost += effect.lost()
        return np.unique(np.concatenate(levels))

    def _settled(self, platen: Motion, breaks: Array, seen: Array) -> tuple[Path, Array, Mesh]:
        """Path and contact force, on a mesh that has the times `seen` among its edges.

        Where contact ends is known in advance only for a stiff frame. Otherwise, and where the
        history of the force counts, two rounds on a coarse mesh find it.
        """
        guess: tuple[Array, Array] = (np.zeros(1), np.zeros(1))
        if any(effect.remembers for effect in self._nested):
            for _ in range(_SEARCHES):
                mesh = Mesh(graded(breaks, self.cells // _COARSER))
                path, force, given = self._balance(platen, mesh, guess)
                guess = mesh.time.ravel(), given.ravel()
                breaks = _apart(np.union1d(breaks, _losses(mesh, path, force)))
        mesh = Mesh(np.unique(np.concatenate([graded(breaks, self.cells), seen])))
        path, force, _ = self._balance(platen, mesh, guess)
        return path, force, mesh

    def _balance(
        self, platen: Motion, mesh: Mesh, guess: tuple[Array, Array]
    ) -> tuple[Path, Array, Array]:
        """Find path, force and deflection with d = D - deflection(F), from a guess over time."""
        displacement = platen.displacement(mesh.time)
        if not self.bonded and displacement.min() < -_OFF_MM:
            displacement = np.maximum(displacement, 0.0)
        # A frame that yields does not change the velocity, nor where there is one.
        _, velocity = self._let_through(displacement, _velocity(platen, mesh))
        yielding = any(effect.order == FRAME for effect in self._nested)
        stroke = float(np.abs(displacement).max())
        given = np.interp(mesh.time, *guess)
        for _ in range(_ROUNDS):
            depth, _ = self._let_through(displacement - given, velocity)
            path = Path(platen, mesh, depth, velocity, self.constants.force(depth))
            force = self._contact_force(path)
            if not yielding:
                return path, force, given
            if self.frame_speed:
                slowed = velocity / (1.0 + self._gain(path, force, given))
                path = replace(path, velocity=slowed)
                force = self._contact_force(path)
            wanted = sum((e.deflection(force) for e in self._nested), np.zeros_like(force))
            change = (wanted - given) / (1.0 + self._gain(path, force, wanted))
            given = given + change
            if np.abs(change).max() <= self.settled * stroke:
                return path, force, given
        raise RuntimeError("the simulation stopped: frame and pad find no balance")

    def _gain(self, path: Path, force: Array, yielded: Array) -> Array:
        """Estimate how far the frame yields back for 1 mm: compliance times stiffness."""
        pressed = force > 0
        stiffness = self.constants.stiffness(path.depth)
        return np.where(pressed, yielded / np.where(pressed, force, 1.0) * stiffness, 0.0)

    def _let_through(self, depth: Array, velocity: Array) -> tuple[Array, Array]:
        """Depth and velocity that the contact lets through to the pad."""
        for effect in reversed(self._nested):
            depth, velocity = effect.on_depth(depth, velocity)
        if not self.bonded and any(effect.slides for effect in self._nested):
            depth, velocity = np.maximum(depth, 0.0), np.where(depth > 0.0, velocity, 0.0)
        return depth, velocity

    def _contact_force(self, path: Path) -> Array:
        force = self._material_force(path)
        for effect in self._nested:
            if effect.order <= CONTACT:
                force = effect.on_force(force, path)
        sticky = any(effect.order == CONTACT for effect in self._nested)
        return force if self.bonded or sticky else np.maximum(force, 0.0)

    def _material_force(self, path: Path) -> Array:
        shares, rates = self._modes
        rate_factor = np.ones_like(path.depth)
        for effect in self._nested:
            rate_factor = rate_factor * effect.rate_factor(path.depth)
        force = shares[0] * path.elastic
        for share, rate in zip(shares[1:], rates, strict=True):
            force = force + share * (path.elastic - path.follow(rate * rate_factor, path.elastic))
        return force


def _velocity(platen: Motion, mesh: Mesh) -> Array:
    """Velocity of the platen at the nodes, 0 where it has left the pad's surface behind."""
    away = platen.displacement(mesh.time) < 0
    return np.where(away, 0.0, platen.velocity(mesh.time))


def _breaks(platen: Motion, levels: Array) -> Array:
    """Return the times where acceleration jumps or the displacement crosses a level."""
    starts = [piece.start for piece in platen.pieces]
    crossings = [_crossings(piece, level) for piece in platen.pieces for level in levels]
    return np.unique(np.concatenate([starts, [platen.duration], *crossings]))


def _crossings(piece: Piece, level: float) -> Array:
    """Return the times at which a piece passes a displacement, without its ends."""
    a, b, c = 0.5 * piece.acceleration, piece.velocity, piece.displacement - level
    root = b * b - 4.0 * a * c
    if root < 0 or (a == 0 and b == 0):
        return np.zeros(0)
    q = -0.5 * (b + np.copysign(np.sqrt(root), b))
    roots = np.array([c / q if q else 0.0, q / a if a else 0.0])
    margin = 1e-9 * piece.duration
    return piece.start + roots[(roots > margin) & (roots < piece.duration - margin)]


def _apart(breaks: Array) -> Array:
    """Leave out breaks that follow another at once."""
    return breaks[np.append(True, np.diff(breaks) > 1e-12 * breaks[-1])]


def _losses(mesh: Mesh, path: Path, force: Array) -> Array:
    """Return the times at which contact or force begin or end, roughly."""
    time = mesh.time.ravel()
    zeros = [np.zeros(0)]
    for values in (path.depth.ravel(), force.ravel()):
        here, there = values[:-1] > 0, values[1:] > 0
        zeros.append(_zero(time, values, np.flatnonzero(here & ~there), -1))
        zeros.append(_zero(time, values, np.flatnonzero(~here & there), +2))
    return np.concatenate(zeros)


def _zero(time: Array, values: Array, cell: NDArray[np.intp], towards: int) -> Array:
    """Extend the line through the last two values above 0 to 0."""
    near = cell if towards < 0 else cell + 1
    far = np.clip(near + (-1 if towards < 0 else 1), 0, time.size - 1)
    rise = values[near] - values[far]
    useful = (time[near] != time[far]) & (rise < 0)
    safe = np.where(useful, rise, 1.0)
    zero = time[near] - values[near] * (time[near] - time[far]) / safe
    low, high = time[cell], time[cell + 1]
    inside = useful & (zero > low) & (zero < high)
    return np.where(inside, zero, low)
