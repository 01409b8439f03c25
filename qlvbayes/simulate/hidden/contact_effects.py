"""Effects where the platen meets the pad, and in the frame that carries both."""

from __future__ import annotations

from dataclasses import dataclass
from math import e

import numpy as np

from ..platen import full_retraction_protocol
from .effect import CONTACT, FRAME, Effect, Recipe, depth_of, peak_of, per_depth
from .mesh import Array, Path, recur, running_max


@dataclass(frozen=True)
class InterfaceSlip(Effect):
    """d -> e, de = (1 - yielding e sgn(dd)) dd: the specimen slides in its grips; yielding in 1/mm.

    No more than the elastic force at e = 1/yielding is transmitted. For a bonded specimen; of a
    loose one the depth stays at 0 where e would fall below.
    """

    name = "interface_slip"
    recipe = Recipe("yielding", 0.05, 2.0, per_depth)
    order = 39
    slides = True
    remembers = True

    yielding: float

    def on_depth(self, depth: Array, velocity: Array) -> tuple[Array, Array]:
        steps = np.diff(depth.ravel())
        lost = self.yielding * np.abs(steps)
        mean = np.where(lost > 0.0, -np.expm1(-lost) / np.where(lost > 0.0, lost, 1.0), 1.0)
        e = recur(np.exp(-lost), steps * mean, float(depth.flat[0])).reshape(depth.shape)
        return e, velocity * (1.0 - self.yielding * e * np.sign(velocity))


@dataclass(frozen=True)
class PermanentSet(Effect):
    """d -> max(d - share dmax, 0), dmax the largest arriving depth so far, also while loading."""

    name = "permanent_set"
    recipe = Recipe("share", 0.05, 0.5)
    order = 40
    shares = ("share",)

    share: float

    def on_depth(self, depth: Array, velocity: Array) -> tuple[Array, Array]:
        deepest = np.maximum(running_max(depth), 0.0)
        remains = np.maximum(depth - self.share * deepest, 0.0)
        growing = (depth >= deepest) & (velocity > 0)
        slowed = velocity * np.where(growing, 1.0 - self.share, 1.0)
        return remains, np.where(remains > 0, slowed, 0.0)

    def kinks(self, largest: Array) -> Array:
        return np.concatenate([self.share * largest, largest])


@dataclass(frozen=True)
class ContactOffset(Effect):
    """d -> max(d - gap, 0), gap of either sign, mm.

    With gap < 0 the pad has rested at depth -gap for a long time when the test begins.
    """

    name = "contact_offset"
    recipe = Recipe("gap", 0.03, 0.5, depth_of)
    order = 41
    signed = ("gap",)

    gap: float

    def lost(self) -> float:
        return self.gap

    def on_depth(self, depth: Array, velocity: Array) -> tuple[Array, Array]:
        remains = np.maximum(depth - self.gap, 0.0)
        return remains, np.where(remains > 0, velocity, 0.0)

    def kinks(self, largest: Array) -> Array:
        return np.array([self.gap])


@dataclass(frozen=True)
class Backlash(Effect):
    """d -> p + play/2, p' = 0 until d leaves p -+ play/2: play between encoder and platen; mm.

    Pressed inwards the depth is the encoder's; on the way back the platen waits for the play.
    """

    name = "backlash"
    recipe = Recipe("play", 0.02, 0.5, depth_of)
    order = 42

    play: float

    def on_depth(self, depth: Array, velocity: Array) -> tuple[Array, Array]:
        position, followed = float(depth.flat[0]), []
        for d in depth.ravel().tolist():
            position = max(position, d) if d > position else min(position, d + self.play)
            followed.append(position)
        behind = np.array(followed).reshape(depth.shape)
        lag = behind - depth
        waits = (lag > 0.0) & (lag < self.play * (1.0 - 1e-9))
        return behind, np.where(waits, 0.0, velocity)

    def kinks(self, largest: Array) -> Array:
        return largest - self.play


@dataclass(frozen=True)
class Adhesion(Effect):
    """F -> F exp(-(F / strength)^2 / (2 e)) where F < 0; strength in N.

    The greatest tension is the strength, at F = -strength sqrt(e); beyond, the pad lets go.
    """

    name = "adhesion"
    recipe = Recipe("strength", per=peak_of, cap=1.0, protocols=(full_retraction_protocol,))
    order = CONTACT

    strength: float

    def on_force(self, force: Array, path: Path) -> Array:
        if self.strength == 0.0:
            return np.maximum(force, 0.0)
        pull = np.minimum(force, 0.0) / self.strength
        return force * np.exp(-np.minimum(pull * pull / (2.0 * e), 700.0))


@dataclass(frozen=True)
class FrameCompliance(Effect):
    """d -> d - compliance F, F the contact force itself; compliance in mm/N.

    The depth and all that depends on it (relaxation, pressure, friction, largest depth) follow
    exactly. Drags that go with the velocity take the one that a stiff frame would give: the
    pad's is smaller by compliance dF/dt, which is neglected.
    """

    name = "frame_compliance"
    recipe = Recipe("compliance", 0.03, 1.0, lambda x: x.depth / x.peak)
    remembers = True
    order = FRAME

    compliance: float

    def deflection(self, force: Array) -> Array:
        return self.compliance * force
