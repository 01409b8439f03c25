"""Check that nothing is compiled twice, in this process or in the next."""

import re
from pathlib import Path

import jax
import numpy as np
import pytest

import qlvbayes
from qlvbayes.inference.forward import pieces
from qlvbayes.io.executables import Executables


@pytest.fixture
def cache(tmp_path):
    before = jax.config.values["jax_compilation_cache_dir"]
    jax.config.update("jax_compilation_cache_dir", str(tmp_path))
    yield tmp_path
    jax.config.update("jax_compilation_cache_dir", before)


@pytest.fixture
def counted():
    """Makes a function as another process would, and the shapes with which any was traced."""
    seen = []

    def fresh():
        def doubled(x):
            seen.append(x.shape)
            return 2.0 * x

        return doubled

    return fresh, seen


def test_an_executable_is_kept_for_the_next_process(cache, counted):
    fresh, seen = counted
    values = np.arange(3.0)
    for _ in range(2):
        run = Executables(fresh(), {}, "doubled")
        for _ in range(2):
            np.testing.assert_array_equal(run(values), 2.0 * values)
    assert seen == [(3,)]
    assert len(list(cache.glob("*.xla"))) == 1


@pytest.mark.parametrize(("size", "meaning"), [(4, "doubled"), (3, "doubled at another level")])
def test_other_shapes_and_meanings_are_kept_apart(cache, counted, size, meaning):
    fresh, _ = counted
    Executables(fresh(), {}, "doubled")(np.ones(3))
    np.testing.assert_array_equal(Executables(fresh(), {}, meaning)(np.ones(size)), 2.0)
    assert len(list(cache.glob("*.xla"))) == 2


def test_other_numbers_and_other_nesting_are_kept_apart(cache):
    run = Executables(lambda parts: sum(part.sum() for part in parts), {}, "sum")
    assert run((np.ones(3), np.ones(3))) == 6.0
    assert run((np.ones(3, int), np.ones(3))) == 6.0
    assert run([np.ones(3), np.ones(3)]) == 6.0
    assert len(list(cache.glob("*.xla"))) == 3


def test_nothing_is_kept_of_what_may_change_unseen(cache, counted):
    fresh, _ = counted
    np.testing.assert_array_equal(Executables(fresh(), {}, None)(np.ones(3)), 2.0)
    assert not list(cache.glob("*.xla"))


def test_what_is_damaged_is_compiled_again(cache, counted):
    fresh, seen = counted
    Executables(fresh(), {}, "doubled")(np.ones(3))
    (file,) = cache.glob("*.xla")
    whole = file.read_bytes()
    file.write_bytes(whole[: len(whole) // 2])
    np.testing.assert_array_equal(Executables(fresh(), {}, "doubled")(np.ones(3)), 2.0)
    Executables(fresh(), {}, "doubled")(np.ones(3))
    assert len(seen) == 2


def test_what_is_forgotten_comes_back(cache, counted):
    fresh, seen = counted
    run = Executables(fresh(), {}, "doubled")
    run(np.ones(3))
    run.forget()
    np.testing.assert_array_equal(run(np.ones(3)), 2.0)
    assert len(seen) == 1


def test_options_that_this_xla_does_not_know_are_left_out(monkeypatch):
    options = {"xla_llvm_disable_expensive_passes": True, "xla_is_not_called_so": False}
    monkeypatch.setattr(pieces, "_QUICKEST", options)
    pieces._known_options.cache_clear()
    try:
        assert pieces._known_options() == {"xla_llvm_disable_expensive_passes"}
    finally:
        pieces._known_options.cache_clear()


def test_an_executable_depends_on_all_source_that_its_function_may_call_on():
    """Modules of the package that laws and effects import are part of its key."""
    root = Path(qlvbayes.__file__).parent
    within = [root / name for name in pieces.MADE_OF]
    files = [file for path in within for file in ([path] if path.is_file() else path.rglob("*.py"))]
    # executables keeps what the others make; checks of new laws, lists of names and words of
    # notices are called by no force
    uncalled = ("executables", "conformance", "catalogue", "wording")
    others = {f"qlvbayes/io/{name}.py" for name in uncalled}
    imports = re.compile(r"^\s*from (qlvbayes[\w.]*) import", re.MULTILINE)
    for file in files:
        for name in imports.findall(file.read_text(encoding="utf-8")):
            path = root.parent.joinpath(*name.split("."))
            source = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
            assert str(source.relative_to(root.parent)) in others or source in files, (file, name)
