"""`qlvbayes diagnose` of pads with six tests: from the shell, and where the time goes."""

import cProfile
import os
import pstats
import sys
import tempfile
import time

from timing import QLVBAYES, command_s, into_new_folders

PARTS = {  # file and function to part
    ("experiment.py", "prepare"): "motion, phases, noise floor",
    ("search.py", "begin"): "modes of the baseline model",
    ("search.py", "expand_beam"): "neighbours: laws and effects",
    ("diagnose.py", "_sample_next"): "evidence by sampling",
    ("summarizing.py", "summarize"): "tests left out, adequacy, vetoes, what cannot be seen",
}


def shell_times(cache, file="data/hidden.csv"):
    """Seconds: cold (nothing compiled before), then with the compile cache that this left."""
    return into_new_folders("diagnose", file, cache=cache)


def in_process(cache, measurements="data/hidden.csv"):
    """(part, seconds): a first diagnosis in this process, a second one, and parts of a third."""
    os.environ["QLVBAYES_CACHE"] = cache
    import qlvbayes as q

    pad = q.read_study(measurements).pads[0]
    marks = [(name, _diagnosed_s(pad)) for name in ("first in a process", "once compiled")]
    profile = cProfile.Profile()
    profile.runcall(lambda: q.Specimen(pad).diagnose())
    found = pstats.Stats(profile).stats
    for (file, function), part in PARTS.items():
        keys = [k for k in found if k[2] == function and "qlvbayes" in k[0] and k[0].endswith(file)]
        seconds = sum(found[k][3] for k in keys)
        marks.append((f"{part} (with the profiler)", seconds))
    return marks


def pads_in_turn(hide="viscous_drag"):
    """(pad, seconds) of three simulated pads in one file, with nothing compiled before."""
    with tempfile.TemporaryDirectory() as folder:
        os.environ["QLVBAYES_CACHE"] = f"{folder}/cache"
        file = f"{folder}/pads.csv"
        command_s([QLVBAYES, "simulate", "-o", file, "--hide", hide], f"{folder}/simulation")
        import qlvbayes as q

        return [(f"pad {pad.name}", _diagnosed_s(pad)) for pad in q.read_study(file).pads]


def _diagnosed_s(pad):
    import qlvbayes as q

    start = time.perf_counter()
    q.Specimen(pad).diagnose()
    return time.perf_counter() - start


if __name__ == "__main__":
    for part, seconds in in_process(sys.argv[1]) if len(sys.argv) > 1 else pads_in_turn():
        print(f"{part}\t{seconds:.2f}")
