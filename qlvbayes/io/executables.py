"""Share compiled functions between processes, on disk as XLA made them.

JAX's own cache keeps what XLA made of a function, but each process traces and lowers the function
anew to look it up: a hundred small functions take seconds. Here the executable itself lies in the
folder of that cache, under a name made from all that the function depends on.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import time
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from platform import machine
from typing import Any
from uuid import uuid4
from weakref import WeakSet

import jax
import jaxlib
from jax.experimental.serialize_executable import deserialize_and_load, serialize
from jax.stages import Compiled

from qlvbayes.io.files import write_whole

try:
    import fcntl
except ImportError:  # absent on some systems: processes then compile the same function twice
    fcntl = None  # type: ignore[assignment]

_PATIENCE_S = 120.0  # to wait while another process compiles: far longer than any function takes
_LOOK_S = 0.02  # between two attempts to lock the file
_PROCESSOR = Path("/proc/cpuinfo")
_INSTANCES: WeakSet[Executables] = WeakSet()


class Executables:
    """Function of arrays, compiled once for all processes and each shape of its arguments.

    Arguments are nested tuples and lists of arrays; ``options`` are XLA's, which this version
    knows. ``meaning`` is a text that identifies all that the function depends on apart from its
    arguments, its source included; None where that is unknown (a user's own effect may call on any
    file), and nothing is kept then.
    """

    def __init__(
        self, function: Callable[..., Any], options: dict[str, bool], meaning: str | None
    ) -> None:
        self._function, self._options = function, options
        self._meaning = None if meaning is None else f"{meaning} {sorted(options.items())}"
        self._by_shape: dict[Any, Callable[..., Any]] = {}
        _INSTANCES.add(self)

    def __call__(self, *arguments: Any) -> Any:
        """Return what the function returns."""
        leaves, structure = jax.tree.flatten(arguments)
        shapes = structure, tuple((leaf.shape, leaf.dtype) for leaf in leaves)
        run = self._by_shape.get(shapes)
        if run is None:
            run = self._by_shape[shapes] = self._loaded_or_compiled(arguments, shapes)
        return run(*arguments)

    def _loaded_or_compiled(self, arguments: Any, shapes: Any) -> Callable[..., Any]:
        """Return the compiled function from the cache, or compile it and store it there."""
        folder = jax.config.values["jax_compilation_cache_dir"]
        if self._meaning is None or not folder:
            return jax.jit(self._function, compiler_options=self._options)
        text = f"{_environment()} {self._meaning} {shapes}"
        file = Path(folder) / f"{hashlib.sha256(text.encode()).hexdigest()}.xla"
        with suppress(Exception):  # damaged, or of another machine: it is compiled again
            return _loaded(file.read_bytes(), arguments)
        with _one_at_a_time(file):
            with suppress(Exception):  # it is there by now if another process was first
                return _loaded(file.read_bytes(), arguments)
            compiled = self._compiled(arguments)
            # a failure to serialise or to write only costs the next process time
            with suppress(Exception):
                content = zlib.compress(pickle.dumps(serialize(compiled)), 1)
                _loaded(content, arguments)
                write_whole(file, content)
        return compiled

    def _compiled(self, arguments: Any) -> Compiled:
        """Compile under a unique name, as XLA cannot serialise what JAX's cache gave it."""

        def named(*arguments: Any) -> Any:
            return self._function(*arguments)

        named.__name__ = f"kept_{uuid4().hex}"
        return jax.jit(named, compiler_options=self._options).lower(*arguments).compile()

    def forget(self) -> None:
        """Drop what is compiled; it comes from the cache when it is needed again."""
        self._by_shape.clear()


@contextmanager
def _one_at_a_time(file: Path) -> Iterator[None]:
    """Make processes that would compile the same function wait for the first of them."""
    lock = file.with_suffix(".lock")
    try:
        locked = lock.open("wb") if fcntl else None
    except OSError:
        locked = None
    if locked is None:
        yield
        return
    with locked:
        deadline = time.monotonic() + _PATIENCE_S
        with suppress(OSError):
            while time.monotonic() < deadline and not _try_lock(locked.fileno()):
                time.sleep(_LOOK_S)
        try:
            yield
        finally:
            lock.unlink(missing_ok=True)


def _try_lock(number: int) -> bool:
    """Lock the open file of this number, and return whether that succeeded."""
    try:
        fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _loaded(content: bytes, arguments: Any) -> Callable[..., Any]:
    """Return an executable that was stored; XLA raises an error where it does not run."""
    run: Callable[..., Any] = deserialize_and_load(*pickle.loads(zlib.decompress(content)))
    run(*arguments)
    return run


def forget_executables() -> None:
    """Drop all that is compiled in this process."""
    for instance in list(_INSTANCES):
        instance.forget()


@cache
def _environment() -> str:
    """Return what every executable depends on: JAX, XLA's flags, the processor, and this file."""
    flags = ""
    if _PROCESSOR.exists():
        lines = _PROCESSOR.read_text().splitlines()
        flags = next((line for line in lines if line.startswith(("flags", "Features"))), "")
    flags += os.environ.get("XLA_FLAGS", "")
    digest = hashlib.sha256(flags.encode() + Path(__file__).read_bytes()).hexdigest()
    return f"{jax.__version__} {jaxlib.__version__} {jax.default_backend()} {machine()} {digest}"
