"""Configure JAX (double precision, compiled functions kept between processes), and use threads."""

from __future__ import annotations

import os
import threading
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TypeVar

from threadpoolctl import threadpool_limits

THREADS = "QLVBAYES_THREADS"  # environment variable: how many threads this process may use
_MAPPINGS = Path("/proc/self/maps")
_inside = threading.local()  # whether a thread works on a part already
Part = TypeVar("Part")
Result = TypeVar("Result")
_MANY = 20_000  # mappings, of the 65 530 that Linux allows a process; LLVM fails beyond


def cache_folder() -> Path:
    """Return the folder of compiled functions: ``$QLVBAYES_CACHE``, or the user's cache folder."""
    chosen = os.environ.get("QLVBAYES_CACHE")
    if chosen:
        return Path(chosen)
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(base) / "qlvbayes" / "jax"


def configure() -> None:
    """Switch JAX to float64, to synchronous dispatch, and to the persistent compile cache."""
    import jax  # not above: loading JAX calls this function

    jax.config.update("jax_enable_x64", True)
    # the calling thread computes, so that several threads compute side by side
    jax.config.update("jax_cpu_enable_async_dispatch", False)
    if jax.config.values["jax_compilation_cache_dir"] is not None:
        return
    folder = cache_folder()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return
    if not os.access(folder, os.W_OK):
        return
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", 0)
    # an entry that is damaged is compiled again
    warnings.filterwarnings("ignore", "Error (reading|writing) persistent compilation cache")


def cores() -> int:
    """Return how many threads are of use: ``$QLVBAYES_THREADS``, or the cores available."""
    asked = os.environ.get(THREADS, "")
    if asked.isdecimal() and int(asked) > 0:
        return int(asked)
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def in_threads(work: Callable[[Part], Result], parts: Sequence[Part]) -> list[Result]:
    """Return what ``work`` gives for each part, with as many threads as there are cores.

    Within a thread of this function all parts are done one after another. The results do not depend
    on the number of threads.
    """
    if len(parts) < 2 or cores() < 2 or getattr(_inside, "thread", False):
        return [work(part) for part in parts]

    def marked(part: Part) -> Result:
        _inside.thread = True
        return work(part)

    with ThreadPoolExecutor(min(cores(), len(parts))) as threads:
        return list(threads.map(marked, parts))


def one_blas_thread() -> AbstractContextManager[object]:
    """Return a context manager that keeps BLAS to one thread."""
    limits: AbstractContextManager[object] = threadpool_limits(limits=1, user_api="blas")
    return limits


def forget_compiled() -> None:
    """Drop compiled functions where they take too many of a process's memory mappings."""
    if not _MAPPINGS.exists():  # not Linux: no such limit
        return
    if _MAPPINGS.read_text().count("\n") > _MANY:
        import jax

        jax.clear_caches()
