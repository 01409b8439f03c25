"""ns a step of the exported C header, both ways, and how far single precision drifts.

    python benchmarks/c_steps.py

Exports a pad like B of the paper for each elastic law with two modes and for a power law's
spectrum, compiles with gcc -O2 and times a minute at 1 kHz: ramp, hold, back, hold.
"""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import arviz_base
import numpy as np

from qlvbayes.simulate import TABLE_1
from qlvbayes.use.exports.target import export

REPEATS = 5  # of which the fastest counts, in processor time: what else runs here only adds
PAD = TABLE_1["B"]
PRONY = {"c": np.array(PAD.c), "v": np.array(PAD.v)}
BARE = {"m": 0.34, "b": 1.165, **PRONY}
MODELS = {
    "exponential, 2 modes": BARE,
    "linear, 2 modes": {"m": 0.34, **PRONY},
    "polynomial:3, 2 modes": {"m": 0.34, "k2": 0.15, "k3": 0.1, **PRONY},
    "toe, 2 modes": {"m": 0.34, "b": 1.165, "toe": 0.4, **PRONY},
    "hertz, 2 modes": {"m": 0.6, "n": 1.5, **PRONY},
    "exponential, power law": {"m": 0.34, "b": 1.165, "c0": 0.2, "alpha": 0.3, "tau": 0.05},
    "exponential, 2 modes, viscous_drag": {**BARE, "viscous_drag.eta": 0.01},
    "with friction, stress_softening and frame_compliance too": {
        **{**BARE, "viscous_drag.eta": 0.01, "stress_softening.s": 0.15},
        **{"friction.strength": 0.1, "friction.reach": 0.05, "frame_compliance.compliance": 0.05},
    },
}

TIMED = """
#define _POSIX_C_SOURCE 200809L
#include <stdio.h>
#include <time.h>
#include "pad_B.h"
#define N 60000
static pad_B_real depth[N], force[N], back[N];
static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}
int main(void)
{
    const pad_B_constants k = PAD_B_MEDIAN;
    const pad_B_real h = (pad_B_real)1e-3;
    double fastest[2] = {1e9, 1e9};
    int i, round;
    for (i = 0; i < N; i++) {
        const double t = 1e-3 * i;
        const double later = t < 30.8 ? 1.6 - (t - 30.0) : 0.8;
        depth[i] = (pad_B_real)(t < 0.08 ? 20.0 * t : t < 30.0 ? 1.6 : later);
    }
    for (round = 0; round < REPEATS; round++) {
        pad_B_state s, r;
        double begin = now(), middle, end;
        pad_B_init(&s);
        for (i = 0; i < N; i++) { force[i] = pad_B_force(&k, &s, h, depth[i]); }
        middle = now();
        pad_B_init(&r);
        for (i = 0; i < N; i++) { back[i] = pad_B_displacement(&k, &r, h, force[i]); }
        end = now();
        if (middle - begin < fastest[0]) { fastest[0] = middle - begin; }
        if (end - middle < fastest[1]) { fastest[1] = end - middle; }
    }
    fprintf(stderr, "%.1f %.1f", 1e9 * fastest[0] / N, 1e9 * fastest[1] / N);
    for (i = 0; i < N; i++) { printf("%.17g\\n", (double)force[i]); }
    return 0;
}
""".replace("REPEATS", str(REPEATS))


def run(folder, *flags):
    """Force from displacement and the inverse in ns a step, and the forces."""
    (folder / "timed.c").write_text(TIMED)
    command = ["gcc", "-std=c99", "-O2", *flags, "-o", folder / "timed", folder / "timed.c", "-lm"]
    subprocess.run(command, check=True)
    done = subprocess.run([folder / "timed"], check=True, capture_output=True, text=True)
    return *map(float, done.stderr.split()), [float(x) for x in done.stdout.split()]


def rows():
    """(model, force ns, displacement ns, the same of floats, drift over the peak force)."""
    found = []
    for name, constants in MODELS.items():
        with tempfile.TemporaryDirectory() as out:
            posterior = Path(out) / "B" / "posterior.nc"
            posterior.parent.mkdir()
            draws = {key: np.tile(x, (4, 50, *[1] * np.ndim(x))) for key, x in constants.items()}
            arviz_base.from_dict({"posterior": draws}).to_netcdf(posterior, engine="h5netcdf")
            folder = export(out, "B", "c")[0].parent
            *double, exact = run(folder)
            *single, rough = run(folder, "-DPAD_B_FLOAT")
            drift = max(abs(a - b) for a, b in zip(exact, rough, strict=True)) / max(exact)
        found.append((name, *double, *single, drift))
    return found


if __name__ == "__main__":
    if shutil.which("gcc") is None:
        sys.exit("no gcc here")
    print("| model | force ns | displacement ns | float: force ns | displacement ns | drift |")
    print("|---|---:|---:|---:|---:|---:|")
    for name, *times, drift in rows():
        print(f"| {name} | {' | '.join(f'{t:.0f}' for t in times)} | {drift:.0e} |")
