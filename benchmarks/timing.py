"""Timing of calls in this process, and of commands in their own."""

import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import jax
import numpy as np

QLVBAYES = str(Path(sys.executable).with_name("qlvbayes"))  # the command


def call_ms(function, *arguments, repeats=15):
    """Median wall time (ms) of a call, after one that compiles."""
    jax.block_until_ready(function(*arguments))
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        jax.block_until_ready(function(*arguments))
        times.append(time.perf_counter() - start)
    return 1e3 * float(np.median(times))


def command_s(command, cache, **environment):
    """Wall time (s) of a command with its compile cache in ``cache``; fails if it fails."""
    env = {**os.environ, "QLVBAYES_CACHE": cache, **environment}
    start = time.perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env=env)
    return time.perf_counter() - start


def into_new_folders(*words, runs=2, cache=None):
    """Wall times (s) of one command that shares a compile cache, each into a folder of its own.

    Into a folder that holds its results already a command would compute nothing.
    """
    with tempfile.TemporaryDirectory() as folder:
        cache = cache or f"{folder}/cache"
        outputs = [f"{folder}/results-{k}" for k in range(runs)]
        return [command_s([QLVBAYES, *words, "-o", output], cache) for output in outputs]


def peak_mb():
    """Largest resident size of this process so far (MB)."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def in_new_process(file, *arguments, **environment):
    """Return what a script prints when it runs in a process of its own, with its own memory."""
    command = [sys.executable, str(file), *map(str, arguments)]
    env = {**os.environ, **environment}
    done = subprocess.run(command, check=True, capture_output=True, text=True, env=env)
    return done.stdout.strip()
