"""What was traced once is not traced again, in this process or in the next."""

import jax
import numpy as np
import pytest

from qlvbayes.inference.forward import traced as module
from qlvbayes.inference.forward.traced import traced


@pytest.fixture
def cache(tmp_path):
    before = jax.config.values["jax_compilation_cache_dir"]
    jax.config.update("jax_compilation_cache_dir", str(tmp_path))
    yield tmp_path
    jax.config.update("jax_compilation_cache_dir", before)


@pytest.fixture
def counted():
    """A function, and the shapes with which it was traced."""
    seen = []

    def doubled(x):
        seen.append(x.shape)
        return 2.0 * x

    return doubled, seen


def like(size):
    return (jax.ShapeDtypeStruct((size,), np.float64),)


def next_process(*arguments):
    traced.cache_clear()
    return traced(*arguments)


def test_a_trace_is_kept_for_the_next_process(cache, counted):
    function, seen = counted
    values = np.arange(3.0)
    for _ in range(2):
        run = next_process(function, like(3), "doubled")
        np.testing.assert_array_equal(run(values), 2.0 * values)
    assert seen == [(3,)]
    assert len(list(cache.glob("*.traced"))) == 1


@pytest.mark.parametrize(("size", "meaning"), [(4, "doubled"), (3, "doubled at another level")])
def test_other_shapes_and_meanings_are_kept_apart(cache, counted, size, meaning):
    function, _ = counted
    next_process(function, like(3), "doubled")
    next_process(function, like(size), meaning)
    assert len(list(cache.glob("*.traced"))) == 2


def test_nothing_is_kept_of_what_may_change_unseen(cache, counted):
    function, _ = counted
    np.testing.assert_array_equal(next_process(function, like(3), None)(np.ones(3)), 2.0)
    assert not list(cache.glob("*.traced"))


def test_options_that_this_xla_does_not_know_are_left_out(monkeypatch):
    options = {"xla_llvm_disable_expensive_passes": True, "xla_is_not_called_so": False}
    monkeypatch.setattr(module, "_QUICK", options)
    module._known_options.cache_clear()
    try:
        assert module._known_options() == {"xla_llvm_disable_expensive_passes": True}
        assert module._compiled(lambda x: x + 1.0)(1.0) == 2.0
    finally:
        module._known_options.cache_clear()
