"""Consecutive tests of one pad, which relaxes in the pauses between them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from qlvbayes.io.checks import InputError
from qlvbayes.simulate.material import Material
from qlvbayes.simulate.platen import PAPER_ACCELERATION, Hold, Move, Platen, Step
from qlvbayes.simulate.rig import SAMPLE_RATE, Record, SimulatedTest, stream
from qlvbayes.simulate.sensors import Noise, encode, thin

RETURN_SPEED = 20.0
"""Speed at which the platen leaves the pad after a test, mm/s."""


@dataclass(frozen=True)
class Sequence:
    """Programs joined by pauses in which the platen goes back to zero and waits."""

    platen: Platen  # of the whole
    names: tuple[str, ...]  # of the tests
    # begins, ends: their times (s) in the whole
    begins: tuple[float, ...]
    ends: tuple[float, ...]


def join_programs(
    programs: Mapping[str, Iterable[Step]],
    pause_s: float,
    *,
    return_speed: float | None = RETURN_SPEED,
    acceleration_limit: float = PAPER_ACCELERATION,
) -> Sequence:
    """Join programs with ``pause_s`` (s) between a test's end and the next one's beginning."""
    if not programs:
        raise InputError("no tests to do", remedy="give at least one program")
    steps: list[Step] = []
    begins: list[float] = []
    ends: list[float] = []
    for program in programs.values():
        if ends:
            steps += _pause(steps, pause_s, return_speed, acceleration_limit)
        begins.append(_duration(steps, acceleration_limit))
        steps += program
        ends.append(_duration(steps, acceleration_limit))
    platen = Platen(tuple(steps), acceleration_limit)
    return Sequence(platen, tuple(programs), tuple(begins), tuple(ends))


def record_sequence(
    material: Material,
    programs: Mapping[str, Iterable[Step]],
    noise: Noise,
    seed: int,
    *,
    pad: str = "pad",
    pause_s: float = 5.0,
    continuous: bool = True,
    return_speed: float | None = RETURN_SPEED,
    acceleration_limit: float = PAPER_ACCELERATION,
    sample_rate: float = SAMPLE_RATE,
    max_rows: int | None = None,
) -> list[SimulatedTest]:
    """Run the programs one after another on one pad; tests are named 'pad-program'."""
    programs = {name: tuple(program) for name, program in programs.items()}
    whole = join_programs(
        programs, pause_s, return_speed=return_speed, acceleration_limit=acceleration_limit
    )
    if not continuous and return_speed is None:
        raise InputError("a pad that is not let go cannot rest", remedy="give a return speed")
    tests = [
        _Test(f"{pad}-{name}", begin, *_sampled(whole, begin, end, sample_rate, max_rows))
        for name, begin, end in zip(whole.names, whole.begins, whole.ends, strict=True)
    ]
    if continuous:
        forces = _continuous(material, whole, tests)
    else:
        forces = _rested(material, programs, acceleration_limit, tests)
    return [
        test.recorded(pad, whole, force, noise, seed)
        for test, force in zip(tests, forces, strict=True)
    ]


@dataclass(frozen=True)
class _Test:
    """A test's samples: name, beginning in the sequence (s), times and readings."""

    name: str
    begin: float
    time: NDArray[np.float64]
    read: NDArray[np.float64]
    kept: NDArray[np.intp]

    def recorded(
        self, pad: str, whole: Sequence, force: NDArray[np.float64], noise: Noise, seed: int
    ) -> SimulatedTest:
        """Return the test with its noise, which is drawn for all samples, kept or not."""
        own = self.time - self.begin
        errors = noise.draw(own, stream(seed, self.name))[self.kept]
        time, true = own[self.kept], whole.platen.displacement(self.time[self.kept])
        record = Record(time, self.read[self.kept], force + errors, true, force)
        return SimulatedTest(pad, self.name, self.begin, record)


def _sampled(
    whole: Sequence, begin: float, end: float, rate: float, max_rows: int | None
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.intp]]:
    """Return times of a test in the sequence, encoder readings, and the indices of kept rows."""
    if not rate > 0:
        raise InputError(f"the sample rate must be above 0, not {rate} 1/s")
    time = np.minimum(begin + np.arange(int((end - begin) * rate + 1e-6) + 1) / rate, end)
    read = encode(whole.platen.displacement(time))
    kept = np.arange(time.size) if max_rows is None else thin(time - begin, read, max_rows)
    return time, read, kept


def _continuous(
    material: Material, whole: Sequence, tests: list[_Test]
) -> list[NDArray[np.float64]]:
    """Return forces of the kept samples, solved along all tests and pauses."""
    times = [test.time[test.kept] for test in tests]
    force = material.force(whole.platen, np.concatenate(times))
    return np.split(force, np.cumsum([time.size for time in times])[:-1])


def _rested(
    material: Material,
    programs: Mapping[str, Iterable[Step]],
    acceleration_limit: float,
    tests: list[_Test],
) -> list[NDArray[np.float64]]:
    """Return forces of the kept samples, every test begun on a rested pad."""
    forces = []
    for program, test in zip(programs.values(), tests, strict=True):
        platen = Platen(tuple(program), acceleration_limit, test.begin)
        times = np.clip(test.time[test.kept] - test.begin, 0.0, platen.duration)
        forces.append(material.force(platen, times))
    return forces


def _pause(
    done: list[Step], pause_s: float, return_speed: float | None, acceleration_limit: float
) -> list[Step]:
    """Return the way back and the wait, together as long as the pause."""
    back: list[Step] = [] if return_speed is None else [Move(0.0, return_speed)]
    duration = _duration([*done, *back], acceleration_limit) - _duration(done, acceleration_limit)
    if not pause_s > duration:
        raise InputError(
            f"a pause of {pause_s:g} s is too short for the way back, which takes {duration:.3g} s",
            remedy="lengthen the pause or raise the return speed",
        )
    return [*back, Hold(pause_s - duration)]


def _duration(steps: list[Step], acceleration_limit: float) -> float:
    """Return the length (s) of a program that may be empty."""
    return Platen(tuple(steps), acceleration_limit).duration if steps else 0.0
