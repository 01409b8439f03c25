"""Simulated tests as a tidy CSV that says that it is simulated."""

from __future__ import annotations

import gzip
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from qlvbayes.checks import InputError

from .constants import Constants
from .platen import PAPER_ACCELERATION
from .rig import SAMPLE_RATE, SimulatedTest, simulate_study
from .sensors import ENCODER_STEP, Noise

_COLUMNS = "pad,test,start_s,time_s,displacement_mm,force_N"


def write_csv(path: str | Path, tests: Iterable[SimulatedTest], heading: Sequence[str]) -> None:
    """Write tests as one tidy CSV, compressed if the name ends in .gz.

    Each line of `heading` becomes a comment above the columns. Times keep 4 decimals,
    displacement 3 (1 um), force 5. Written to a temporary name and renamed; the same
    tests give the same bytes.

    Raises
    ------
    InputError
        The file cannot be written, or two times of a test agree to 4 decimals.
    """
    path = Path(path)
    comments = [f"# {' '.join(line.split())}" for line in heading]
    lines = [*comments, _COLUMNS, *(row for test in tests for row in _rows(test))]
    content = ("\n".join(lines) + "\n").encode()
    if path.suffix == ".gz":
        content = gzip.compress(content, mtime=0)
    part = path.with_name(path.name + ".part")
    try:
        part.write_bytes(content)
        part.replace(path)
    except OSError as error:
        part.unlink(missing_ok=True)
        raise InputError(
            f"cannot be written ({error.strerror})", file=path, remedy="choose another place"
        ) from error


def simulate_file(
    path: str | Path,
    pads: Mapping[str, Constants],
    rates: Sequence[float],
    noise: Noise,
    seed: int,
    max_rows: int | None,
    command: str,
) -> None:
    """Simulate the paper's study and write it; `command` is quoted in the file's heading."""
    tests = simulate_study(pads, rates, noise, seed, max_rows)
    write_csv(path, tests, _heading(pads, noise, seed, max_rows, command))


def _rows(test: SimulatedTest) -> list[str]:
    record = test.record
    if np.any(np.diff(np.round(record.time, 4)) <= 0):
        raise InputError(
            f"test {test.name} has times closer than 0.0001 s", remedy="sample at 10 kHz or slower"
        )
    place = f"{test.pad},{test.name},{test.start_s:.4f}"
    columns = zip(
        record.time.tolist(), record.displacement.tolist(), record.force.tolist(), strict=True
    )
    return [f"{place},{t:.4f},{d:z.3f},{f:z.5f}" for t, d, f in columns]


def _heading(
    pads: Mapping[str, Constants], noise: Noise, seed: int, max_rows: int | None, command: str
) -> list[str]:
    rows = "every sample" if max_rows is None else f"at most {max_rows} rows a test"
    return [
        "simulated, not measured: pads pressed to 1.6 mm, held 30 s, back to 0.8 mm at 1 mm/s, "
        f"held 30 s; acceleration at most {PAPER_ACCELERATION:g} mm/s2",
        f"command: {command}",
        f"seed {seed}; encoder step {ENCODER_STEP:g} mm; load-cell noise: white sd "
        f"{noise.white:g} N, correlated sd {noise.correlated:g} N over "
        f"{noise.correlation_time:g} s; sampled at {SAMPLE_RATE:g} Hz, {rows}",
        *(_constants_line(name, constants) for name, constants in pads.items()),
    ]


def _constants_line(name: str, constants: Constants) -> str:
    c = ", ".join(f"c[{i}] = {x:g}" for i, x in enumerate(constants.c))
    v = ", ".join(f"v[{i}] = {x:g} 1/s" for i, x in enumerate(constants.v, start=1))
    law = f"m = {constants.m:g} N/mm, b = {constants.b:g} 1/mm"
    return f"pad {name}: {', '.join(filter(None, [law, c, v]))}"
