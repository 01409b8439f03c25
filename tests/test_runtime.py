"""Compiled functions are dropped before a process runs out of memory mappings."""

import jax
import jax.numpy as jnp
import pytest

from qlvbayes.io import runtime

MAPS = "00400000-00452000 r-xp 00000000 08:02 173521 /usr/bin/python\n"


@pytest.mark.parametrize(("lines", "kept"), [(100, True), (30_000, False)])
@pytest.mark.slow
def test_compiled_functions_are_dropped_where_they_are_many(tmp_path, monkeypatch, lines, kept):
    maps = tmp_path / "maps"
    maps.write_text(MAPS * lines)
    monkeypatch.setattr(runtime, "_MAPPINGS", maps)
    double = jax.jit(lambda x: 2.0 * x)
    double(jnp.ones(3))
    assert double._cache_size() == 1
    runtime.forget_compiled()
    assert double._cache_size() == int(kept)
    assert float(double(jnp.ones(3))[0]) == 2.0


def test_a_system_without_the_list_needs_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(runtime, "_MAPPINGS", tmp_path / "none")
    runtime.forget_compiled()
