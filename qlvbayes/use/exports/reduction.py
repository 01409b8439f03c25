"""A pad without memory: fewer numbers for contact in rigid-body simulators, and what that costs."""

from __future__ import annotations

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from scipy.optimize import nnls

from qlvbayes.io.checks import InputError
from qlvbayes.io.units import unit_system
from qlvbayes.laws.motion import Motion
from qlvbayes.use.exports.pad import ExportedPad

SI = unit_system("m", "N")
_RATES = 5  # loading rates, evenly in their logarithm from the slowest tested to the fastest
_RAMP = 100  # times in a ramp, and as many in a hold


@dataclass(frozen=True, eq=False)
class Pressing:
    """Ramps to the tested depth at tested rates, each held as long as was tested, in SI units.

    depth (m), speed (m/s), force (N) of all times of all ramps, one after another; ramp: whether
    the time lies in a ramp.
    """

    depth: np.ndarray
    speed: np.ndarray
    force: np.ndarray
    ramp: np.ndarray


@dataclass(frozen=True)
class Miss:
    """By how much fewer numbers miss the force, over the largest one."""

    rms: float
    largest: float
    hold: float

    def __str__(self) -> str:
        return (
            f"misses the force by {self.rms:.0%} rms and {self.largest:.0%} at most of the peak "
            f"force over the tested range, by {self.hold:.0%} rms in holds"
        )


def pressing(pad: ExportedPad) -> Pressing:
    """The force of the middle draw, effects and all, over the tested range.

    Raises InputError where the pad has no displacement and force, or its tested range is unknown.
    """
    if pad.units.dimensionless:
        raise InputError(
            f"pad {pad.name} has strain and stress, not displacement and force",
            remedy="use --to abaqus, ansys, febio or comsol",
        )
    if pad.covered is None:
        raise InputError(
            f"the results of pad {pad.name} do not say which depths and rates were tested",
            remedy="run qlvbayes fit, or use --to json",
        )
    reach = pad.covered
    found = [_pressed(pad, rate) for rate in np.geomspace(reach.slowest, reach.fastest, _RATES)]
    depth, speed, force, ramp = (np.concatenate(x) for x in zip(*found, strict=True))
    metre = pad.units.factor_to(SI, "displacement")
    newton = pad.units.factor_to(SI, "force")
    return Pressing(metre * depth, metre * speed, newton * force, ramp)


def _pressed(pad: ExportedPad, rate: float) -> tuple[np.ndarray, ...]:
    assert pad.covered is not None
    end = pad.covered.depth / rate
    ramp = np.linspace(0.0, end, _RAMP + 1)
    hold = end + pad.covered.hold * np.linspace(0.0, 1.0, _RAMP + 1)[1:]
    time = np.concatenate([ramp, hold])
    depth = np.minimum(rate * time, pad.covered.depth)
    rising = time <= end
    speed = np.where(rising, rate, 0.0)
    motion = Motion(*map(jnp.asarray, (time, depth, speed, np.zeros_like(time))))
    return depth, speed, np.asarray(pad.model.force(motion)), rising


def fitted(columns: list[np.ndarray], force: np.ndarray) -> np.ndarray:
    """Factors, none below zero, that bring the columns closest to the force in the mean square."""
    sizes = [float(np.max(np.abs(column))) for column in columns]
    matrix = np.stack([x / size for x, size in zip(columns, sizes, strict=True)], axis=-1)
    return nnls(matrix, force)[0] / np.array(sizes)


def miss(found: np.ndarray, pressed: Pressing) -> Miss:
    """Of a force (n,) that stands for that of the pad."""
    off = (found - pressed.force) / np.max(pressed.force)
    hold = off[~pressed.ramp]
    rms = (float(np.sqrt(np.mean(x**2))) for x in (off, hold))
    whole, still = rms
    return Miss(whole, float(np.max(np.abs(off))), still)
