"""Many pads by one process and by two: what a second core gains.

Pads with constants drawn at random, by the simulator, a file each; the compile cache is warm, and
each process has one thread, so that one process cannot use the second core.
"""

import tempfile
from pathlib import Path

import numpy as np
from timing import QLVBAYES, command_s

from qlvbayes.simulate import NOISES, draw_constants, simulate_study, write_csv

PADS = {"fit": 16, "diagnose": 6}
_RATES, _ROWS, _SEED = (1.0, 20.0, 100.0), 400, 7


def gains():
    """(command, pads, seconds by one process, seconds by two) of each command."""
    rows = []
    for command, count in PADS.items():
        with tempfile.TemporaryDirectory() as base:
            measured = Path(base) / "measured"
            measured.mkdir()
            _simulate(measured, count)

            def seconds(jobs, command=command, base=base, measured=measured):
                with tempfile.TemporaryDirectory() as out:
                    line = [QLVBAYES, command, str(measured), "-o", out, "--jobs", str(jobs)]
                    return command_s(line, f"{base}/cache", QLVBAYES_THREADS="1")

            seconds(2)  # compiles
            rows.append((command, count, seconds(1), seconds(2)))
    return rows


def _simulate(folder, count):
    rng = np.random.default_rng(_SEED)
    for k in range(count):
        seed = int(rng.integers(2**32))
        pads = {f"pad{k:02}": draw_constants(rng)}
        tests = simulate_study(pads, _RATES, NOISES["correlated"], seed, _ROWS)
        write_csv(folder / f"pad{k:02}.csv", tests, ["simulated"])


if __name__ == "__main__":
    for command, count, one, two in gains():
        print(f"{command}\t{count}\t{one:.1f}\t{two:.1f}\t{one / two:.2f}")
