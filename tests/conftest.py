"""Double precision and the compile cache for every test, and the paper's pads as models."""

import ctypes
import gc
import os
import shutil
import sys
from collections import defaultdict
from importlib.metadata import version
from pathlib import Path

# Tests run few times what they compile: without XLA's optimising they take 0.6 of the time (fits
# and checks 0.8, laws and effects 0.45). From 0.11 on XLA stops at the first option.
if version("jaxlib").startswith("0.10."):
    os.environ.setdefault(
        "XLA_FLAGS",
        "--xla_cpu_use_fusion_emitters=false --xla_backend_optimization_level=0 "
        "--xla_cpu_parallel_codegen_split_count=1",  # the other core has tests of its own
    )

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import settings
from support import shared

from qlvbayes.io.runtime import configure, forget_compiled

LARGE = 1500  # MiB, from which compiled functions are dropped after a file
STATUS = Path("/proc/self/status")
# glibc keeps what threads have freed: a third of a worker's memory after a diagnosis
TRIM = getattr(ctypes.CDLL(None), "malloc_trim", bool) if sys.platform == "linux" else bool

settings.register_profile("quick", max_examples=25)  # other ones in every run
settings.load_profile("quick")
gc.disable()  # until all tests are collected: imports leave no garbage worth a look
configure()

from qlvbayes.io import binary  # noqa: E402
from qlvbayes.laws.elastic.exponential import Exponential  # noqa: E402
from qlvbayes.laws.relaxation.prony import Prony  # noqa: E402
from qlvbayes.model.model import Model  # noqa: E402
from qlvbayes.motion import experiment  # noqa: E402
from qlvbayes.simulate import TABLE_1  # noqa: E402


@pytest.hookimpl(tryfirst=True)  # before pytest itself looks at marks
def pytest_collection_modifyitems(items):
    """Mark all cases of a test marked ``few`` as slow but for so many, evenly spread."""
    cases = defaultdict(list)
    for item in items:
        if item.get_closest_marker("few"):
            cases[item.nodeid.partition("[")[0]].append(item)
    for same in cases.values():
        (count,) = same[0].get_closest_marker("few").args
        kept = set(np.linspace(0, len(same) - 1, count).round().astype(int).tolist())
        for place, item in enumerate(same):
            if place not in kept:
                item.add_marker(pytest.mark.slow)


def pytest_collection_finish():
    """Collect garbage seldom, and not among what imports left: that took a tenth of the time."""
    gc.freeze()
    gc.set_threshold(10_000, 10, 10)
    gc.enable()


@pytest.fixture(scope="module", autouse=True)
def _forget_compiled():
    yield
    forget_compiled()
    TRIM(0)
    if _resident() > LARGE:
        jax.clear_caches()
        gc.collect()
        TRIM(0)


def _resident():
    """Memory that this process holds, MiB; 0 where the system does not tell."""
    if not STATUS.exists():
        return 0
    line = next(x for x in STATUS.read_text().splitlines() if x.startswith("VmRSS:"))
    return int(line.split()[1]) // 1024


@pytest.fixture(scope="session", autouse=True)
def _once(tmp_path_factory):
    """Smooth a recording and read a binary file once: many tests prepare the same pads.

    Tests of the motion and of the readers apart call `trajectory.smooth` and `apart.read_apart`.
    """
    if "PYTEST_XDIST_WORKER" in os.environ:
        shared.FOLDER = tmp_path_factory.getbasetemp().parent
    smooth, read, motions, vectors = experiment.smooth, binary.read_apart, {}, {}

    def smooth_once(time, displacement, *options):
        key = (*(np.asarray(x, np.float64).tobytes() for x in (time, displacement)), *options)
        if key not in motions:
            if len(motions) > 300:  # of tests over drawn records, which come once
                motions.clear()
            motions[key] = smooth(time, displacement, *options)
        return motions[key]

    def read_once(kind, path, *options):
        key = (kind, path.read_bytes(), *options)
        if key not in vectors:
            vectors[key] = read(kind, path, *options)
        return [(name, values.copy()) for name, values in vectors[key]]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(experiment, "smooth", smooth_once)
        patch.setattr(binary, "read_apart", read_once)
        yield


@pytest.fixture(scope="session")
def browser():
    """A browser of this machine; none is downloaded."""
    sync_api = pytest.importorskip("playwright.sync_api", reason="no playwright: no page is opened")
    names = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
    if (found := next(filter(None, map(shutil.which, names)), None)) is None:
        pytest.skip(f"none of {', '.join(names)} is installed: no page is opened in a browser")
    with sync_api.sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=found, args=["--no-sandbox"])
        yield running
        running.close()


@pytest.fixture(scope="session")
def paper_model():
    """Give the model with the constants of a pad in the paper's Table 1."""

    def build(pad="B", *, bonded=False):
        constants = TABLE_1[pad]
        relaxation = Prony(jnp.array(constants.c), jnp.array(constants.v))
        return Model(Exponential(constants.m, constants.b), relaxation, bonded)

    return build
