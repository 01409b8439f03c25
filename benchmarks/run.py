"""Run all benchmarks, or some sections, and write benchmarks/results.md: `make bench`.

Sections that are not run stay as they are on the page.
"""

import argparse
import datetime
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import c_steps
import density
import diagnosis
import force
import many
import numpy as np
import pieces
import shell
import stepping
from timing import QLVBAYES, command_s, in_new_process


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="+", choices=SECTIONS, default=list(SECTIONS))
    chosen = parser.parse_args().only
    known = _written()
    for name in chosen:
        print(name, file=sys.stderr)
        heading, section = SECTIONS[name]
        known[heading] = f"{_origin()}\n\n{section()}"
        parts = [
            f"## {title}\n\n{known[title]}" for title, _ in SECTIONS.values() if title in known
        ]
        PAGE.write_text("\n".join([HEADING, *parts]), encoding="utf-8")
    print(PAGE)


PAGE = Path("benchmarks/results.md")
HEADING = """# Performance

Measured by `make bench`, section by section. Times are medians; a ratio compares two things
measured in the same run.
"""


def _written():
    """The text of each section of the page by its heading."""
    if not PAGE.exists():
        return {}
    parts = PAGE.read_text(encoding="utf-8").split("\n## ")[1:]
    return {head: text.strip("\n") + "\n" for head, _, text in (p.partition("\n") for p in parts)}


def _origin():
    return f"Measured on {datetime.date.today()}, commit {commit()}, {machine()}."


def machine():
    return f"{os.cpu_count()} cores ({platform.machine()}), Python {platform.python_version()}"


def commit():
    command = ["git", "rev-parse", "--short", "HEAD"]
    return subprocess.run(command, capture_output=True, text=True).stdout.strip() or "unknown"


def force_section():
    samples, ours, rival, error = force.against_lfilter()
    rows = "\n".join(
        f"| {n:,} | {ms:.2f} | {ns:.0f} | {mb:.0f} | {' | '.join(map(_ms, rivals))} |"
        for n, ms, ns, mb, *rivals in force.growth()
    )
    return f"""\
One pad, six tests at 1 kHz, {samples:,} samples, two modes: **{ours:.1f} ms**, against
{rival:.1f} ms for `scipy.signal.lfilter` recursions ({rival / ours:.2f} times as fast; lfilter
needs evenly spaced samples, this does not). The two differ by at most {error:.0e} N.

The last three columns are scipy and numpy, in ms, for evenly spaced samples: the recursion, one
convolution a mode by FFT, and a plain convolution, which is not waited for beyond 100,000 samples.

| samples (one test) | ms | ns a sample | peak memory MB | lfilter | FFT | convolution |
|---:|---:|---:|---:|---:|---:|---:|
{rows}
"""


def _ms(taken):
    return "-" if np.isnan(taken) else f"{taken:.2f}"


def pieces_section():
    with tempfile.TemporaryDirectory() as cache:
        printed = in_new_process(Path(pieces.__file__), QLVBAYES_CACHE=cache)
    rows = [line.split("\t") for line in printed.splitlines()]
    table = "\n".join(f"| {' | '.join(row)} |" for row in rows)
    whole = sum(float(row[1]) for row in rows)
    return f"""\
Microseconds a set of constants, eight at once, on the record of `data/hidden.csv` (six tests): by
NumPy, as `diagnose` runs it, against the same model compiled by JAX and called once for all tests
and sets. The two take turns; the quickest of {pieces.REPEATS} counts.
The first calls by NumPy take {whole:.1f} s together.

| model | first call s | NumPy | JAX | ratio |
|---|---:|---:|---:|---:|
{table}
"""


def stepping_section():
    steps = "\n".join(
        f"| {draws} | {forward:,.0f} | {back:,.0f} |"
        for draws in stepping.DRAWS
        for forward, back in [stepping.steps_a_second(draws)]
    )
    dual = "\n".join(
        f"| {count:,} | {forward:.2f} | {back:.1f} | {back / forward:.0f} | {error:.0e} |"
        for count in stepping.LENGTHS
        for forward, back, error in [stepping.dual_against_forward(count)]
    )
    rivals = "\n".join(
        f"| {count:,} | {ours:.1f} | {rival:.0f} | {rival / ours:.1f} | {apart:.0e} |"
        for count in stepping.IVP_LENGTHS
        for ours, rival, apart in [stepping.dual_against_ivp(count)]
    )
    return f"""\
`Stepper`, called from Python once a step, two modes (a step of 1 kHz needs 1,000 a second):

| draws | force, steps a second | displacement, steps a second |
|---:|---:|---:|
{steps}

A test of one pad, compiled as a whole: its force from the displacement, and the displacement from
that force, which cannot be cut into chunks; the last column is the way there and back.

| samples | force ms | displacement ms | ratio | error mm |
|---:|---:|---:|---:|---:|
{dual}

Creep under 1 N put on in 0.1 s, against `scipy.integrate.solve_ivp` (LSODA, relative tolerance
1e-8, no step longer than 100 samples), which solves it as differential equations:

| samples | displacement ms | solve_ivp ms | ratio | apart mm |
|---:|---:|---:|---:|---:|
{rivals}
"""


def c_section():
    if shutil.which("gcc") is None:
        return "Not measured: no gcc here.\n"
    rows = "\n".join(
        f"| {name} | {' | '.join(f'{t:.0f}' for t in times)} | {drift:.0e} |"
        for name, *times, drift in c_steps.rows()
    )
    return f"""\
Nanoseconds a step of processor time (gcc -O2), a minute at 1 kHz: ramp, hold, back, hold. A step of
1 kHz has 1,000,000. `float` is single precision; its drift is over the peak force.

| model | force | displacement | float: force | float: displacement | drift |
|---|---:|---:|---:|---:|---:|
{rows}
"""


def density_section():
    rows, grid, blocks = density.rows()
    table = "\n".join(f"| {noise} | {w} | {d:.2f} |" for noise, w, d in rows)
    return f"""\
Pad B of `data/pads.csv`, all six tests: grids of {grid[1]} points, {blocks[1]} blocks a test.

| noise | walkers | log density ms |
|---|---:|---:|
{table}
"""


def shell_section():
    cold, warm = shell.shell_times()
    words = command_s([QLVBAYES, "--help"], "build/cache")
    rows = _rows(in_new_process(Path(shell.__file__)))
    return f"""\
Cold (nothing compiled before): **{cold:.1f} s**; with a warm compile cache: **{warm:.1f} s**;
`qlvbayes --help`: **{words:.2f} s**. Where the time goes in a warm process (then follow the summary
and the results file):

| part | s |
|---|---:|
{rows}
"""


def diagnosis_section():
    script = Path(diagnosis.__file__)
    with tempfile.TemporaryDirectory() as cache:
        cold, warm = diagnosis.shell_times(cache)
        rows = _rows(in_new_process(script, cache))
    pads = _rows(in_new_process(script))
    return f"""\
From the shell with figures, on `data/hidden.csv`: cold (nothing compiled before) **{cold:.1f} s**,
with a warm compile cache **{warm:.1f} s**. In one process with that cache, without figures:

| part | s |
|---|---:|
{rows}

Pads of one file share what is compiled. Three simulated ones with a drag hidden in them, in a
process with nothing compiled before, without figures:

| pad | s |
|---|---:|
{pads}
"""


def many_section():
    rows = _rows(in_new_process(many.__file__))
    return f"""\
A folder of simulated pads of three tests each, a file a pad, by `--jobs 1` and `--jobs 2` from the
shell, one thread a process, with a warm compile cache. Starting a process and loading what is
compiled is part of the time of each.

| command | pads | one process s | two s | times as fast |
|---|---:|---:|---:|---:|
{rows}
"""


def _rows(printed):
    rows = (" | ".join(line.split("\t")) for line in printed.splitlines())
    return "\n".join(f"| {row} |" for row in rows)


SECTIONS = {
    "force": ("Force on a full record", force_section),
    "pieces": ("The force of a hypothesis", pieces_section),
    "stepping": ("Step by step, and displacement from force", stepping_section),
    "header": ("The exported C header", c_section),
    "density": ("Log density on the reduced record", density_section),
    "fit": ("`qlvbayes fit` of one pad from the shell", shell_section),
    "diagnose": ("`qlvbayes diagnose` of one pad, six tests, all effects", diagnosis_section),
    "many": ("Many pads on two cores", many_section),
}


if __name__ == "__main__":
    main()
