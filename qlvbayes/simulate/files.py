"""Simulated tests as a tidy CSV whose heading says that it is simulated."""

from __future__ import annotations

import gzip
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from qlvbayes.io.checks import InputError, check_known
from qlvbayes.io.files import write_whole

from .constants import Constants
from .creep import creep_study
from .hidden import Effect, HiddenPad
from .material import Material, Pad
from .platen import PAPER_ACCELERATION, PROTOCOLS
from .rig import PAUSE_S, SAMPLE_RATE, SimulatedTest, record_study
from .sensors import ENCODER_STEP, Noise

_COLUMNS = "pad,test,start_s,time_s,displacement_mm,force_N"


def write_csv(
    path: str | Path,
    tests: Iterable[SimulatedTest],
    heading: Sequence[str],
    groups: Mapping[str, str] | None = None,
) -> None:
    """Write tests as one tidy CSV, compressed if the name ends in .gz."""
    path = Path(path)
    comments = [f"# {' '.join(line.split())}" for line in heading]
    tests, groups = list(tests), groups or {}
    more = {}
    if any(test.control == "force" for test in tests):
        more["control"] = [test.control for test in tests]
    if groups:
        more["group"] = [groups.get(test.pad, "") for test in tests]
    first = ",".join([*more, _COLUMNS])
    labels = [",".join(label) for label in zip(*more.values(), strict=True)] or [""] * len(tests)
    rows = (
        f"{label},{row}" if label else row
        for label, test in zip(labels, tests, strict=True)
        for row in _rows(test)
    )
    lines = [*comments, first, *rows]
    content = ("\n".join(lines) + "\n").encode()
    if path.suffix == ".gz":
        content = gzip.compress(content, mtime=0)
    _write(path, content)


def simulate_file(
    path: str | Path,
    pads: Mapping[str, Constants],
    rates: Sequence[float],
    noise: Noise,
    seed: int,
    max_rows: int | None,
    command: str,
    effects: Sequence[Effect] = (),
    protocol: str = "paper",
    answer: str | Path | None = None,
    loads: Sequence[float] = (),
    groups: Mapping[str, str] | None = None,
) -> None:
    """Simulate a study and write it; `command` is quoted in the file's heading."""
    if loads and effects:
        raise InputError(
            "a load-controlled test is simulated of the plain pad only",
            remedy="leave out --loads or --hide",
        )
    check_known("protocol", protocol, PROTOCOLS)
    if answer is not None and Path(answer).resolve() == Path(path).resolve():
        raise InputError("data and answer need two files", file=path)
    materials: dict[str, Material] = {
        # a plain pad follows a platen that is drawn off its surface
        name: HiddenPad(constants, tuple(effects))
        if effects or protocol == "pull_off"
        else Pad(constants)
        for name, constants in pads.items()
    }
    programs = {f"{rate:g}": PROTOCOLS[protocol](rate) for rate in rates}
    tests = record_study(materials, programs, noise, seed, max_rows)
    ends = {t.pad: t.start_s + float(t.record.time[-1]) + PAUSE_S for t in tests}
    tests += creep_study(pads, loads, noise, seed, max_rows, ends)
    rig = _rig_lines(protocol if programs else "", noise, max_rows, loads)
    if answer is None:
        heading = [f"command: {command}", f"seed {seed}; {rig[1]}"]
        heading += [_effect_line(effect) for effect in effects]
        heading += [_constants_line(name, constants) for name, constants in pads.items()]
    else:
        _write_answer(answer, effects, pads, noise, seed)
        heading = [rig[1], "constants and hidden effects are kept in a file of their own"]
    write_csv(path, tests, [rig[0], *heading], groups)


def _write_answer(
    path: str | Path,
    effects: Sequence[Effect],
    pads: Mapping[str, Constants],
    noise: Noise,
    seed: int,
) -> None:
    content: dict[str, Any] = {
        "effects": [{"effect": e.name, "parameters": e.parameters} for e in effects],
        "constants": {name: asdict(constants) for name, constants in pads.items()},
        "noise": asdict(noise),
        "seed": seed,
    }
    text = json.dumps(content, indent=2, allow_nan=False) + "\n"
    _write(Path(path), text.encode())


def _write(path: Path, content: bytes) -> None:
    try:
        write_whole(path, content)
    except OSError as error:
        raise InputError(
            f"cannot be written ({error.strerror})", file=path, remedy="choose another place"
        ) from error


def _rows(test: SimulatedTest) -> list[str]:
    record = test.record
    if np.any(np.diff(np.round(record.time, 4)) <= 0):
        raise InputError(
            f"test {test.name} has times closer than 0.0001 s", remedy="sample at 10 kHz or slower"
        )
    prefix = f"{test.pad},{test.name},{test.start_s:.4f}"
    columns = zip(
        record.time.tolist(), record.displacement.tolist(), record.force.tolist(), strict=True
    )
    return [f"{prefix},{t:.4f},{d:z.3f},{f:z.5f}" for t, d, f in columns]


_MOTIONS = {
    "paper": "pressed to 1.6 mm, held 30 s, back to 0.8 mm at 1 mm/s, held 30 s",
    "retraction": "pressed to 1.6 mm, held 10 s, back to 0 at no more than 20 mm/s, held 5 s, "
    "again to 1.6 mm, held 10 s, back to 0 at 1 mm/s, held 5 s",
    "pull_off": "pressed to 1.6 mm, held 10 s, drawn back at 1 mm/s to 0.4 mm above the surface, "
    "held 5 s, twice",
}


def _rig_lines(
    protocol: str, noise: Noise, max_rows: int | None, loads: Sequence[float]
) -> tuple[str, str]:
    rows = "every sample" if max_rows is None else f"at most {max_rows} rows a test"
    done = []
    if protocol:
        done = [f"pads {_MOTIONS[protocol]}; acceleration at most {PAPER_ACCELERATION:g} mm/s2"]
    if loads:
        done.append("loads put on in 0.1 s, held 30 s, taken down to 30 % in 0.3 s, held 30 s")
    return (
        f"simulated, not measured: {'; '.join(done)}",
        f"encoder step {ENCODER_STEP:g} mm; load-cell noise: white sd "
        f"{noise.white:g} N, correlated sd {noise.correlated:g} N over "
        f"{noise.correlation_time:g} s; sampled at {SAMPLE_RATE:g} Hz, {rows}",
    )


def _effect_line(effect: Effect) -> str:
    values = ", ".join(f"{key} = {value:g}" for key, value in effect.parameters.items())
    return f"hidden: {effect.name} ({values})"


def _constants_line(name: str, constants: Constants) -> str:
    c = ", ".join(f"c[{i}] = {x:g}" for i, x in enumerate(constants.c))
    v = ", ".join(f"v[{i}] = {x:g} 1/s" for i, x in enumerate(constants.v, start=1))
    law = f"m = {constants.m:g} N/mm, b = {constants.b:g} 1/mm"
    return f"pad {name}: {', '.join(filter(None, [law, c, v]))}"
