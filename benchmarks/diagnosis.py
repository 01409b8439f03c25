"""`qlvbayes diagnose` of pads with six tests: from the shell, and where the time goes."""

import cProfile
import os
import pstats
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from timing import command_s

PARTS = {  # function to part
    "prepare": "motion, phases, noise floor",
    "plain_fits": "plain fit",
    "contest": "screen and refits of all candidates",
    "held_out": "tests left out",
    "adequacy": "adequacy",
    "other_forms": "effects in other forms",
    "_spring": "spring of free form",
    "summed_up": "what these tests cannot see, ranking",
    "screen": "of these, screens",
}


def shell_times(file="data/hidden.csv"):
    """Seconds: cold (nothing compiled before), then with a warm compile cache."""
    with tempfile.TemporaryDirectory() as folder:
        command = [str(Path(sys.executable).with_name("qlvbayes")), "diagnose", file]
        run = [*command, "-o", f"{folder}/results"]
        return [command_s(run, f"{folder}/cache") for _ in range(2)]


def in_process(file="data/hidden.csv"):
    """(part, seconds): a first diagnosis in this process, a second one, and parts of a third."""
    import qlvbayes as q

    pad = q.read_study(file).pads[0]
    marks = []
    for name in ("first in a process", "once compiled"):
        start = time.perf_counter()
        q.diagnose(q.prepare(pad))
        marks.append((name, time.perf_counter() - start))
    profile = cProfile.Profile()
    profile.runcall(lambda: q.diagnose(q.prepare(pad)))
    found = pstats.Stats(profile).stats
    for function, part in PARTS.items():
        seconds = sum(v[3] for k, v in found.items() if k[2] == function and "qlvbayes" in k[0])
        marks.append((f"{part} (with the profiler)", seconds))
    return marks


def pads_in_turn(hide="viscous_drag"):
    """(pad, seconds) of three simulated pads in one file, with nothing compiled before."""
    with tempfile.TemporaryDirectory() as folder:
        os.environ["QLVBAYES_CACHE"] = f"{folder}/cache"
        file = f"{folder}/pads.csv"
        command = [str(Path(sys.executable).with_name("qlvbayes")), "simulate", "-o", file]
        subprocess.run([*command, "--hide", hide], check=True, stdout=subprocess.DEVNULL)
        import qlvbayes as q

        marks = []
        for pad in q.read_study(file).pads:
            start = time.perf_counter()
            q.diagnose(q.prepare(pad))
            marks.append((f"pad {pad.name}", time.perf_counter() - start))
        return marks


if __name__ == "__main__":
    for part, seconds in pads_in_turn() if "--pads" in sys.argv else in_process():
        print(f"{part}\t{seconds:.2f}")
