"""The paper's rig: platen, pad, encoder and load cell together."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from qlvbayes.io.checks import InputError

from .constants import Constants
from .material import Material, Pad
from .motion import Motion
from .platen import PAPER_RATES, Platen, Step, paper_protocol
from .sensors import NOISES, Noise, encode, thin

SAMPLE_RATE = 1000.0
"""Samples a second of the paper's controller."""

PAUSE_S = 120.0
"""Rest between two tests, s."""


@dataclass(frozen=True)
class Record:
    """A test as measured, and the truth behind it; all arrays (n,), s, mm and N."""

    time: NDArray[np.float64]
    displacement: NDArray[np.float64]
    force: NDArray[np.float64]
    true_displacement: NDArray[np.float64]
    true_force: NDArray[np.float64]

    def thinned(self, max_rows: int) -> Record:
        """Keep only the rows that the data logger keeps."""
        kept = thin(self.time, self.displacement, max_rows)
        return Record(*(getattr(self, column.name)[kept] for column in fields(self)))


@dataclass(frozen=True)
class SimulatedTest:
    """A record with its pad and test in a study; `start_s` is the clock at its first sample."""

    pad: str
    name: str
    start_s: float
    record: Record
    control: str = "displacement"  # what was prescribed, displacement or force


def record_test(
    material: Material,
    platen: Motion,
    noise: Noise,
    rng: np.random.Generator,
    sample_rate: float = SAMPLE_RATE,
    max_rows: int | None = None,
) -> Record:
    """Run one test on any material, sampled from the start of the motion."""
    if not sample_rate > 0:
        raise InputError(f"the sample rate must be above 0, not {sample_rate} 1/s")
    # A last sample that rounding puts just past the end still belongs to the test.
    time = np.arange(int(platen.duration * sample_rate + 1e-6) + 1) / sample_rate
    time[-1] = min(time[-1], platen.duration)
    displacement = platen.displacement(time)
    read, errors = encode(displacement), noise.draw(time, rng)
    if max_rows is not None:
        kept = thin(time, read, max_rows)
        time, displacement, read, errors = time[kept], displacement[kept], read[kept], errors[kept]
    force = material.force(platen, time)
    return Record(time, read, force + errors, displacement, force)


def record_study(
    materials: Mapping[str, Material],
    programs: Mapping[str, Iterable[Step]],
    noise: Noise,
    seed: int,
    max_rows: int | None = None,
) -> list[SimulatedTest]:
    """Run every program on every material, in order, with 120 s of rest between tests."""
    tests = []
    for pad, material in materials.items():
        clock = 0.0
        for number, (label, program) in enumerate(programs.items()):
            name = f"{pad}-{label}"
            platen = Platen(tuple(program), start_s=clock, number=number)
            rng = stream(seed, name)
            record = record_test(material, platen, noise, rng, max_rows=max_rows)
            tests.append(SimulatedTest(pad, name, clock, record))
            clock += platen.duration + PAUSE_S
    return tests


def simulate_test(
    constants: Constants,
    program: Iterable[Step],
    noise: Noise,
    rng: np.random.Generator,
    sample_rate: float = SAMPLE_RATE,
    bonded: bool = False,
) -> Record:
    """Run one program on a quasi-linear pad with the given constants."""
    return record_test(Pad(constants, bonded), Platen(tuple(program)), noise, rng, sample_rate)


def simulate_study(
    constants_by_pad: Mapping[str, Constants],
    rates: Iterable[float] = PAPER_RATES,
    noise: Noise = NOISES["correlated"],
    seed: int = 0,
    max_rows: int | None = None,
) -> list[SimulatedTest]:
    """Run the paper's protocol at each rate (mm/s) on each pad; tests are named 'B-0.1'."""
    pads = {name: Pad(constants) for name, constants in constants_by_pad.items()}
    programs = {f"{rate:g}": paper_protocol(rate) for rate in rates}
    return record_study(pads, programs, noise, seed, max_rows)


def stream(seed: int, name: str) -> np.random.Generator:
    """Return the generator of one test, from the study's seed (0 or more) and the test's name."""
    if seed < 0:
        raise InputError(f"the seed must be at least 0, not {seed}")
    return np.random.default_rng([seed, *name.encode()])
