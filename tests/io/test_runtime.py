"""Compiled functions: a damaged cache is mended, and many are dropped before memory ends."""

import os
import subprocess
import sys
import threading

import jax
import jax.numpy as jnp
import pytest

from qlvbayes.io import runtime
from qlvbayes.io.runtime import THREADS, in_threads

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


COMPUTE = "import qlvbayes, jax, jax.numpy as jnp; print(jax.jit(jnp.cumsum)(jnp.ones(3)))"


def computed(cache):
    environment = os.environ | {"QLVBAYES_CACHE": str(cache)}
    line = [sys.executable, "-c", COMPUTE]
    done = subprocess.run(line, capture_output=True, text=True, timeout=300, env=environment)
    return done.stdout, done.stderr, done.returncode


@pytest.mark.slow
def test_a_damaged_or_useless_cache_costs_nothing_but_time(tmp_path):
    expected = ("[1. 2. 3.]\n", "", 0)
    assert computed(tmp_path) == expected
    entries = {path: path.read_bytes() for path in tmp_path.glob("*-cache")}
    assert len(entries) > 0
    for path, content in entries.items():
        path.write_bytes(content[: len(content) // 2])
    assert computed(tmp_path) == expected
    taken = tmp_path / "a file"
    taken.write_text("mine")
    assert computed(taken) == ("[1. 2. 3.]\n", "", 0)
    assert taken.read_text() == "mine"


def test_parts_are_done_in_threads_and_parts_of_those_one_after_another(monkeypatch):
    monkeypatch.setenv(THREADS, "2")

    def name(_):
        return threading.current_thread().name

    def within(_):
        return name(0), in_threads(name, [0, 1, 2])

    assert in_threads(str, range(5)) == ["0", "1", "2", "3", "4"]
    for own, nested in in_threads(within, [0, 1]):
        assert own != threading.main_thread().name
        assert nested == [own] * 3
    monkeypatch.setenv(THREADS, "1")
    assert in_threads(name, [0, 1]) == [threading.main_thread().name] * 2
