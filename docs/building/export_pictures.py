"""Take the pictures of the pages on exports and on files of machines anew.

python docs/building/export_pictures.py RESULTS [FOLDER], RESULTS as `make demo` leaves it. It needs
gcc: the exported header is compiled and run along a test that was not fitted.
"""

import re
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import qlvbayes as q

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests"))
from support.machine_files import bluehill_3, pressed  # noqa: E402

TEST = "B-1"  # at 1 mm/s; fitted was that at 20 mm/s
_PROGRAM = """#include <stdio.h>
#include "pad_B.h"
int main(void) {
    const pad_B_constants k = PAD_B_MEDIAN;
    pad_B_state s;
    double before = 0.0, t, d;
    pad_B_init(&s);
    while (scanf("%lf %lf", &t, &d) == 2) {
        printf("%.9g\\n", pad_B_force(&k, &s, t - before, d));
        before = t;
    }
    return 0;
}
"""


def of_header(results: Path, time: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Force (N) by the exported C header."""
    q.export(results, "B", "c")
    with tempfile.TemporaryDirectory() as folder:
        source, program = Path(folder, "run.c"), Path(folder, "run")
        source.write_text(_PROGRAM, encoding="utf-8")
        include = f"-I{results / 'B' / 'export' / 'c'}"
        command = ["gcc", "-std=c99", "-O2", include, str(source), "-o", str(program), "-lm"]
        subprocess.run(command, check=True)
        rows = "".join(f"{t:.9g} {d:.9g}\n" for t, d in zip(time, depth, strict=True))
        output = subprocess.run([program], input=rows, capture_output=True, text=True, check=True)
    return np.array(output.stdout.split(), dtype=float)


def of_joint(results: Path, depth: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """Force (N) of the exported MuJoCo joint: its polynomial spring and its damping, in SI."""
    q.export(results, "B", "mujoco")
    text = (results / "B" / "export" / "mujoco" / "pad_B.xml").read_text(encoding="utf-8")
    spring = [float(x) for x in re.search(r'stiffness="([^"]+)"', text)[1].split()]
    damping = float(re.search(r'damping="([^"]+)"', text)[1].split()[0])
    x = 1e-3 * depth
    force = sum(k * x ** (n + 1) for n, k in enumerate(spring)) + damping * 1e-3 * speed
    return np.maximum(force, 0.0)


def exports(results: Path) -> Figure:
    """A test that was not fitted: measured, by the header, by the joint."""
    pad = q.read_study(ROOT / "data" / "pads.csv")["B"]
    trial = next(trial for trial in pad.experiment.trials if trial.name == TEST)
    time, path = trial.test.time, trial.trajectory
    depth, speed = path.displacement(time), path.velocity(time)
    figure = Figure(figsize=(6.7, 3.0), layout="constrained")
    ax = figure.subplots()
    ax.plot(time, trial.test.force, ".", color="0.6", ms=2, label="measured, not fitted")
    ax.plot(time, of_joint(results, depth, speed), "--", color="#d55e00", label="MuJoCo's joint")
    ax.plot(time, of_header(results, time, depth), color="#0072b2", label="C header")
    ax.set(xlabel="time (s)", ylabel="force (N)", title=f"pad B, test {TEST}")
    ax.legend(frameon=False)
    ax.spines[["top", "right"]].set_visible(False)
    return figure


def main() -> None:
    """Draw both pictures."""
    results = Path(sys.argv[1])
    folder = Path(sys.argv[2]) if len(sys.argv) > 2 else ROOT / "docs" / "pictures"
    exports(results).savefig(folder / "exports.png", dpi=200)
    print(folder / "exports.png")
    with tempfile.TemporaryDirectory() as made:
        file = Path(made, "press.csv")
        file.write_bytes(bluehill_3(pressed()))
        command = [sys.executable, "-c", "from qlvbayes.cli.main import run; run()", "convert"]
        tidy = Path(made, "tidy.csv")
        subprocess.run([*command, file, "--pad", "B", "-o", tidy], check=True)
        (folder / "convert.png").write_bytes(tidy.with_suffix(".png").read_bytes())
    print(folder / "convert.png")


if __name__ == "__main__":
    main()
