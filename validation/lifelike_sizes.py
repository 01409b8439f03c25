"""The sizes of what lifelike pads hide, and when an effect can be seen.

An effect can be seen if its force at its mean strength, less what hides it, is at least three times
the unlisted part's, less the same, and three times the noise of a phase mean: root mean squares
over the effect's own phases, which are those in which it has at least half of its largest root mean
square of a phase. What hides it is the best fit by the law's constants, by a scale of each test
within the scatter of the stiffness, and by a contact within its error. It is drawn to have 3 to 12
times as much; where a programme or an unlisted part leaves no room for that below 40 % of the peak,
others are drawn.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from blind.contact import NearContact
from blind.laws import Law, log_uniform
from blind.loadcell import LoadCell
from lifelike_rig import JerkLimited, Plan, kind_of
from numpy.typing import NDArray

from qlvbayes.simulate import Effect, HiddenPad
from qlvbayes.simulate.hidden.effect import Draw

Array = NDArray[np.float64]

UNLISTED_SHARE = (0.003, 0.03)  # of the peak, rms over the moving and held parts
CONTACT_MM = 0.02  # largest error of the given zero
SEEN = 3.0  # times the unlisted part and the noise of a phase mean
CELLS = 120  # of the solver in a stretch
_DRAWING_CELLS = 30  # the same, where only sizes are drawn
_STRONGEST = 12.0  # as SEEN, the largest that is drawn
_LARGEST = 0.4  # of the peak, that an effect may have anywhere
_WIDTHS = 4.0  # before the contact, where this begins
_ROUNDS = 8  # of scaling an effect
_CLOSE = 0.03
_STEP = 1e-3  # of a constant's logarithm
_SHIFT_MM = 1e-3  # of the contact


@dataclass(frozen=True, eq=False)
class Rig:
    """Motion, clocks and sensors of one study.

    contact: where the pad is touched, in the coordinate of the file, mm; width: within which, mm;
    times: sampled times of every test, s.
    """

    plan: Plan
    contact: float
    width: float
    motions: dict[str, JerkLimited]
    logger: str
    times: tuple[Array, ...]

    @cached_property
    def phases(self) -> list[NDArray[np.intp]]:
        """The phase of every sample, numbered over all tests."""
        found, first = [], 0
        for motion, t in zip(self.motions.values(), self.times, strict=True):
            begins = [begin for begin, _ in motion.phases]
            found.append(first + np.searchsorted(begins, t, side="right") - 1)
            first += len(begins)
        return found

    @cached_property
    def on_pad(self) -> list[JerkLimited]:
        """The motions in the coordinate of the pad, in which contact is complete at _WIDTHS."""
        by = _WIDTHS * self.width - self.contact
        return [motion.shifted(by) for motion in self.motions.values()]

    def forces(self, pads: Sequence[HiddenPad]) -> list[Array]:
        """Return the true force (N) of each test's pad at all samples."""
        some = zip(pads, self.on_pad, self.times, strict=True)
        return [pad.force(motion, t) for pad, motion, t in some]

    def rms(self, forces: Sequence[Array]) -> Array:
        """Return the root mean square of every phase."""
        phase, square = np.concatenate(self.phases), np.concatenate(list(forces)) ** 2
        return np.sqrt(np.bincount(phase, square) / np.maximum(np.bincount(phase), 1))


def pad_of(
    law: Law,
    rig: Rig,
    effects: Sequence[Effect],
    cells: int = _DRAWING_CELLS,
    shift: float = 0.0,
) -> HiddenPad:
    """Return the pad; its contact may come later by a shift (mm)."""
    near = NearContact(_WIDTHS * rig.width + shift, rig.width)
    settled = 1e-7 if cells == CELLS else 1e-5
    return HiddenPad(law, (near, *effects), cells=cells, frame_speed=True, settled=settled)


class Sizes:
    """Draws effects of a wanted size in the tests of one pad."""

    def __init__(
        self, law: Law, rig: Rig, bare: list[Array], peak: float, cell: LoadCell, spread: float,
        rng: np.random.Generator,
    ) -> None:  # fmt: skip
        self.law, self.rig, self.bare, self.peak, self.rng = law, rig, bare, peak, rng
        self.spread = spread
        self.share = log_uniform(rng, *UNLISTED_SHARE)
        motions = list(rig.motions.values())
        own = law.v if len(law.v) <= 3 else ()
        end = motions[-1].start_s + motions[-1].duration
        self.draw = Draw(rng, peak, rig.plan.depth, tuple(own), end)
        self.noise = _mean_noise(rig, cell)

    @cached_property
    def slopes(self) -> Array:
        """Weighted changes of the force (N) with what hides an effect, (n + k, k).

        These are the logarithms of the law's constants, a scale of each test, and the contact; the
        last k rows say how far each of them may go before it costs as much as the unlisted part.
        """
        columns, allowed = [], []
        for k, value in enumerate(self.law.constants):
            moved = list(self.law.constants)
            moved[k] = value * (1.0 + _STEP)
            changed = self._changed(self.law.with_constants(tuple(moved)), 0.0)
            columns.append(changed / _STEP)
            allowed.append(np.inf)
        for k in range(len(self.bare)):
            own = [one if n == k else np.zeros_like(one) for n, one in enumerate(self.bare)]
            columns.append(np.concatenate(own))
            allowed.append(max(self.spread, _STEP))
        columns.append(self._changed(self.law, _SHIFT_MM) / _SHIFT_MM)
        allowed.append(CONTACT_MM / 3.0**0.5)
        weighted = np.column_stack(columns) * self.weights[:, None]
        return np.vstack([weighted, np.diag(self.share * self.peak / np.array(allowed))])

    def _changed(self, law: Law, shift: float) -> Array:
        """Return the change of the force (N) with another law or a later contact (mm)."""
        pads = [pad_of(law, self.rig, (), shift=shift)] * len(self.bare)
        return np.concatenate(self.rig.forces(pads)) - np.concatenate(self.bare)

    @cached_property
    def weights(self) -> Array:
        """Equal weights of all phases."""
        phase = np.concatenate(self.rig.phases)
        return 1.0 / np.sqrt(np.bincount(phase)[phase])

    def pattern(self, effect: Effect) -> Array:
        """Return the effect's own force (N), all tests in a row."""
        pads = [pad_of(self.law, self.rig, (effect,))] * len(self.bare)
        return np.concatenate(self.rig.forces(pads)) - np.concatenate(self.bare)

    def left(self, pattern: Array) -> Array:
        """Return the root mean square of every phase of what nothing takes that hides it."""
        if self.law.curve[0] == 0.0:  # air has no constants
            return self.rig.rms([pattern])
        slopes, count = self.slopes, pattern.size
        wanted = np.append(pattern * self.weights, np.zeros(slopes.shape[1]))
        x, *_ = np.linalg.lstsq(slopes, wanted, rcond=None)
        return self.rig.rms([pattern - (slopes[:count] @ x) / self.weights])

    def unlisted(self, kinds: Sequence[str]) -> tuple[Effect, Array]:
        """Draw the unlisted part; what nothing takes of it that hides effects, by phase."""
        wanted = self.share * self.peak
        for kind in self.rng.permutation(kinds).tolist():
            effect, pattern = self._sized(
                kind, lambda p: float(np.sqrt(np.mean(self.rig.rms([p]) ** 2))) / wanted
            )
            share = float(np.sqrt(np.mean(self.rig.rms([pattern]) ** 2))) / wanted
            if abs(share - 1.0) < 3.0 * _CLOSE:
                return effect, self.left(pattern)
        raise RuntimeError("no unlisted part has the wanted size")

    def listed(
        self, name: str, unlisted: Array, air: bool
    ) -> tuple[Effect, float, tuple[float, float, float]]:
        """Draw a listed effect; how many times it exceeds what hides it, and what it leaves."""
        target = log_uniform(self.rng, SEEN * (1.0 + 2.0 * _CLOSE), _STRONGEST)

        def excess(pattern: Array) -> float:
            largest = float(np.abs(pattern).max()) / self.peak
            if air:
                return largest
            return max(self._compared(pattern, unlisted)[0] / target, largest / _LARGEST)

        effect, pattern = self._sized(name, excess)
        seen, left = self._compared(pattern, unlisted)
        return effect, seen, left

    def _compared(
        self, pattern: Array, unlisted: Array
    ) -> tuple[float, tuple[float, float, float]]:
        own = self.left(pattern)
        acts = own >= 0.5 * own.max()
        parts = [float(np.sqrt(np.mean(one[acts] ** 2))) for one in (own, unlisted, self.noise)]
        size, other, noise = (part / self.peak for part in parts)
        return size / max(other, noise), (size, other, noise)

    def _sized(self, name: str, measure: Callable[[Array], float]) -> tuple[Effect, Array]:
        """Return an effect, and its force, whose measure is 1: secants in the logarithms."""
        cls = kind_of(name)
        recipe, sign = cls.recipe, 1.0
        if recipe.size in cls.signed:
            sign = float(self.rng.choice([-1.0, 1.0]))
        unit, shape = sign * recipe.per(self.draw), recipe.shape(self.draw)
        value, power, before = recipe.guess, 1.0, None
        for _ in range(_ROUNDS):
            effect = cls(**{recipe.size: float(unit * value), **shape})
            pattern = self.pattern(effect)
            found = measure(pattern)
            if found <= 0.0 or abs(found - 1.0) < _CLOSE:
                break
            if before is not None and before[0] != value:
                power = float(np.log(found / before[1]) / np.log(value / before[0]))
            before = value, found
            step = found ** (-1.0 / min(max(power, 0.3), 3.0))
            value = min(value * min(max(step, 0.05), 20.0), recipe.cap)
            if value == before[0]:
                break
        return effect, pattern


def _mean_noise(rig: Rig, cell: LoadCell) -> Array:
    """Return the standard deviation (N) of the mean of every phase's noise."""
    sds = []
    for phase, t in zip(rig.phases, rig.times, strict=True):
        for k in range(phase[0], phase[-1] + 1):
            own = t[phase == k]
            memory = np.exp(-np.abs(own[:, None] - own) / cell.time).mean() if own.size else 1.0
            variance = cell.white**2 / max(own.size, 1) + cell.correlated**2 * memory
            sds.append(float(np.sqrt(variance)))
    return np.array(sds)
