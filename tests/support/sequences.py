"""Consecutive tests of one pad, which relaxes in the pauses between them."""

from dataclasses import dataclass

import numpy as np

from qlvbayes.simulate.platen import PAPER_ACCELERATION, Hold, Move, Platen
from qlvbayes.simulate.rig import SAMPLE_RATE, Record, SimulatedTest, stream
from qlvbayes.simulate.sensors import encode, thin

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
    programs, pause_s, *, return_speed=RETURN_SPEED, acceleration_limit=PAPER_ACCELERATION
):
    """Join programs with ``pause_s`` (s) between a test's end and the next one's beginning."""

    def lasting(steps):
        return Platen(tuple(steps), acceleration_limit).duration if steps else 0.0

    steps, begins, ends = [], [], []
    for program in programs.values():
        if ends:  # the way back and the wait are together as long as the pause
            back = [] if return_speed is None else [Move(0.0, return_speed)]
            wait = pause_s - (lasting([*steps, *back]) - lasting(steps))
            assert wait > 0.0
            steps += [*back, Hold(wait)]
        begins.append(lasting(steps))
        steps += program
        ends.append(lasting(steps))
    platen = Platen(tuple(steps), acceleration_limit)
    return Sequence(platen, tuple(programs), tuple(begins), tuple(ends))


def record_sequence(material, programs, noise, seed, *, pause_s, continuous, max_rows):
    """Run the programs one after another on one pad; tests are named 'pad-program'."""
    programs = {name: tuple(program) for name, program in programs.items()}
    whole, parts = join_programs(programs, pause_s), []
    for begin, end in zip(whole.begins, whole.ends, strict=True):
        time = begin + np.arange(int((end - begin) * SAMPLE_RATE + 1e-6) + 1) / SAMPLE_RATE
        time = np.minimum(time, end)
        read = encode(whole.platen.displacement(time))
        parts.append((time, read, thin(time - begin, read, max_rows)))
    times = [time[kept] for time, _, kept in parts]
    if continuous:
        force = material.force(whole.platen, np.concatenate(times))
        forces = np.split(force, np.cumsum([time.size for time in times])[:-1])
    else:
        starts = zip(programs.values(), whole.begins, strict=True)
        platens = [Platen(program, start_s=begin) for program, begin in starts]
        forces = [
            material.force(platen, np.clip(time - platen.start_s, 0.0, platen.duration))
            for platen, time in zip(platens, times, strict=True)
        ]
    tests = []
    for k, (time, read, kept) in enumerate(parts):
        name, begin = f"pad-{whole.names[k]}", whole.begins[k]
        errors = noise.draw(time - begin, stream(seed, name))[kept]
        true = whole.platen.displacement(time[kept])
        record = Record((time - begin)[kept], read[kept], forces[k] + errors, true, forces[k])
        tests.append(SimulatedTest("pad", name, begin, record))
    return tests
