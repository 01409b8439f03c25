"""An exported header, compiled with gcc and run on a motion."""

import shutil
import subprocess

import numpy as np
import pytest

GCC = shutil.which("gcc")
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Wconversion", "-pedantic", "-Werror")
CHECKED = (*STRICT, "-O1", "-fsanitize=undefined", "-fno-sanitize-recover=all")


def needs_gcc(test):
    """Mark a test that compiles C; it is skipped without a compiler."""
    skipped = pytest.mark.skipif(GCC is None, reason="no gcc here: the C code is not compiled")
    return pytest.mark.integration(skipped(test))


# reads kind (0: force of displacements, 1: the inverse), draw (-1: the median), n, where the platen
# is at first, n times (h, x)
DRIVER = """
#include <stdio.h>
#include "PAD_draws.h"
#ifdef ONE_WAY
#define PAD_BACK PAD_force
#else
#define PAD_BACK PAD_displacement
#endif
int main(void)
{
    const PAD_constants median = UPPER_MEDIAN;
    PAD_state s;
    double head[4];
    double step[2];
    long i;
    if (fread(head, sizeof(double), 4, stdin) != 4) { return 1; }
    PAD_init(&s);
    if (head[3] != 0.0) {
        PAD_begin(head[1] < 0.0 ? &median : &PAD_draws[(int)head[1]], &s, (PAD_real)head[3]);
    }
    for (i = 0; i < (long)head[2]; i++) {
        const PAD_constants *k = head[1] < 0.0 ? &median : &PAD_draws[(int)head[1]];
        double out[2];
        if (fread(step, sizeof(double), 2, stdin) != 2) { return 2; }
        out[0] = (double)(head[0] < 0.5
            ? PAD_force(k, &s, (PAD_real)step[0], (PAD_real)step[1])
            : PAD_BACK(k, &s, (PAD_real)step[0], (PAD_real)step[1]));
        out[1] = (double)s.contact;
        fwrite(out, sizeof(double), 2, stdout);
    }
    return 0;
}
"""


class CompiledPad:
    """``files``: of the target; ``flags``: in addition to the strict ones."""

    def __init__(self, folder, files, name="pad_B", flags=CHECKED):
        folder.mkdir(parents=True, exist_ok=True)
        for file, content in files.items():
            (folder / file).write_bytes(content)
        source = folder / "driver.c"
        source.write_text(DRIVER.replace("PAD", name).replace("UPPER", name.upper()))
        self.program = folder / "driver"
        subprocess.run([GCC, *flags, "-o", self.program, source, "-lm"], check=True)

    def force(self, time, displacement, draw=-1, first=None):
        """(n,) forces, and whether the pad is touched; first: where it begins."""
        return self._run(0, draw, time, displacement, displacement[0] if first is None else first)

    def displacement(self, time, force, draw=-1):
        """The inverse."""
        return self._run(1, draw, time, force)

    def _run(self, kind, draw, time, values, first=0.0):
        steps = np.stack([np.diff(time, prepend=time[0]), values], axis=-1)
        given = np.concatenate([[kind, draw, len(time), first], steps.ravel()]).tobytes()
        done = subprocess.run([self.program], input=given, capture_output=True, check=False)
        assert (done.returncode, done.stderr) == (0, b"")
        out = np.frombuffer(done.stdout).reshape(-1, 2)
        return out[:, 0], out[:, 1] > 0.5
