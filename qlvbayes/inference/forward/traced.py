"""Compiled functions whose traces are kept between processes.

JAX's own cache keeps what XLA made of a function, but each process traces the function anew to ask
for it: seconds for a model of many effects. Here what was traced (StableHLO, by `jax.export`) lies
beside it.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import jax
from jax import export

import qlvbayes
from qlvbayes.io.files import write_whole

# What XLA's newer emitters and LLVM's costly passes would gain in speed cannot be measured, and a
# model of the listed effects takes 7 s to compile without them, 11 and 16 s with one and with both.
_QUICK = {"xla_cpu_use_fusion_emitters": False, "xla_llvm_disable_expensive_passes": True}


@cache
def traced(
    function: Callable[..., jax.Array],
    arguments: tuple[jax.ShapeDtypeStruct, ...],
    meaning: str | None,
) -> Callable[..., jax.Array]:
    """The compiled function for such arguments, traced only where no trace is kept.

    meaning: all that the function depends on beside its arguments and the package's own code; None
    where that is not known (a user's own effect may call on any file): nothing is kept then.
    """
    folder = jax.config.values["jax_compilation_cache_dir"]
    if meaning is None or not folder:
        return _compiled(function)
    text = f"{jax.__version__} {jax.default_backend()} {_own_code()} {arguments} {meaning}"
    file = Path(folder) / f"{hashlib.sha256(text.encode()).hexdigest()}.traced"
    if file.is_file():
        return _compiled(export.deserialize(bytearray(file.read_bytes())).call)
    found = export.export(_compiled(function))(*arguments)
    with suppress(OSError):  # a cache only: a full disk costs the next process its time
        write_whole(file, bytes(found.serialize()))
    return _compiled(found.call)


def _compiled(function: Callable[..., jax.Array]) -> Any:
    return jax.jit(function, compiler_options=_known_options())


@cache
def _known_options() -> dict[str, bool]:
    """Those that this XLA knows: options come and go with its versions."""
    found = {}
    for name, value in _QUICK.items():
        with suppress(jax.errors.JaxRuntimeError):
            jax.jit(lambda x: x, compiler_options={name: value}).lower(0.0).compile()
            found[name] = value
    return found


@cache
def _own_code() -> str:
    """Digest of the package's source."""
    root = Path(qlvbayes.__file__).parent
    digest = hashlib.sha256()
    for file in sorted(root.rglob("*.py")):
        digest.update(f"{file.relative_to(root)} ".encode() + file.read_bytes())
    return digest.hexdigest()
