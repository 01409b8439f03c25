"""Compiled functions that are kept between processes as XLA made them.

JAX's own cache keeps what XLA made of a function, but each process traces and lowers the function
anew to ask for it: a hundred small functions take seconds. Here the executable itself lies beside
that cache, found by what the function is made of.
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
except ImportError:  # not of every system: processes then compile the same at the same time
    fcntl = None  # type: ignore[assignment]

_PATIENCE_S = 120.0  # for another process to compile one function: far longer than any takes
_LOOK_S = 0.02
_PROCESSOR = Path("/proc/cpuinfo")
_EVERY: WeakSet[Executables] = WeakSet()


class Executables:
    """A function of arrays, compiled once for all processes for each shape of its arguments.

    function: of arrays in nested tuples and lists, and of nothing else.
    options: XLA's, which this XLA knows.
    meaning: all that the function depends on beside its arguments, its source included; None where
    that is not known (a user's own effect may call on any file): nothing is kept then.
    """

    def __init__(
        self, function: Callable[..., Any], options: dict[str, bool], meaning: str | None
    ) -> None:
        self._function, self._options = function, options
        self._meaning = None if meaning is None else f"{meaning} {sorted(options.items())}"
        self._by_shape: dict[Any, Callable[..., Any]] = {}
        _EVERY.add(self)

    def __call__(self, *arguments: Any) -> Any:
        """What the function gives."""
        leaves, structure = jax.tree.flatten(arguments)
        shapes = structure, tuple((leaf.shape, leaf.dtype) for leaf in leaves)
        run = self._by_shape.get(shapes)
        if run is None:
            run = self._by_shape[shapes] = self._made(arguments, shapes)
        return run(*arguments)

    def _made(self, arguments: Any, shapes: Any) -> Callable[..., Any]:
        """From the cache, or compiled and put there."""
        folder = jax.config.values["jax_compilation_cache_dir"]
        if self._meaning is None or not folder:
            return jax.jit(self._function, compiler_options=self._options)
        text = f"{_here()} {self._meaning} {shapes}"
        file = Path(folder) / f"{hashlib.sha256(text.encode()).hexdigest()}.xla"
        with suppress(Exception):  # damaged, or of another machine: it is compiled again
            return _loaded(file.read_bytes(), arguments)
        with _first_of_all(file):
            with suppress(Exception):  # there by now, if another process was first
                return _loaded(file.read_bytes(), arguments)
            found = self._compiled(arguments)
            # what cannot be written down, or not on a full disk, costs the next process time only
            with suppress(Exception):
                content = zlib.compress(pickle.dumps(serialize(found)), 1)
                _loaded(content, arguments)
                write_whole(file, content)
        return found

    def _compiled(self, arguments: Any) -> Compiled:
        """Under a name that no other has: XLA cannot write down anew what JAX's cache gave it."""

        def named(*arguments: Any) -> Any:
            return self._function(*arguments)

        named.__name__ = f"kept_{uuid4().hex}"
        return jax.jit(named, compiler_options=self._options).lower(*arguments).compile()

    def forget(self) -> None:
        """Drop what is compiled; it comes from the cache when it is needed again."""
        self._by_shape.clear()


@contextmanager
def _first_of_all(file: Path) -> Iterator[None]:
    """Processes that would compile the same wait for the first of them; its end frees them.

    Where files cannot be locked, or the first takes too long, nobody waits.
    """
    lock = file.with_suffix(".lock")
    try:
        held = lock.open("wb") if fcntl else None
    except OSError:
        held = None
    if held is None:
        yield
        return
    with held:
        until = time.monotonic() + _PATIENCE_S
        with suppress(OSError):
            while time.monotonic() < until and not _locked(held.fileno()):
                time.sleep(_LOOK_S)
        try:
            yield
        finally:
            lock.unlink(missing_ok=True)


def _locked(number: int) -> bool:
    """Whether the open file of this number is ours now."""
    try:
        fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _loaded(content: bytes, arguments: Any) -> Callable[..., Any]:
    """An executable that was written down; raises whatever XLA raises where it does not run."""
    run: Callable[..., Any] = deserialize_and_load(*pickle.loads(zlib.decompress(content)))
    run(*arguments)
    return run


def forget_executables() -> None:
    """Drop all that is compiled in this process."""
    for one in list(_EVERY):
        one.forget()


@cache
def _here() -> str:
    """What every executable depends on: JAX, XLA's flags, the processor, how it is kept here.

    Without the flags, what one process compiles quickly and badly (as tests do) would serve all.
    """
    flags = ""
    if _PROCESSOR.exists():
        lines = _PROCESSOR.read_text().splitlines()
        flags = next((line for line in lines if line.startswith(("flags", "Features"))), "")
    flags += os.environ.get("XLA_FLAGS", "")
    digest = hashlib.sha256(flags.encode() + Path(__file__).read_bytes()).hexdigest()
    return f"{jax.__version__} {jaxlib.__version__} {jax.default_backend()} {machine()} {digest}"
