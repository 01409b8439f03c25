"""Described laws: every term keeps the rules of an effect, and a hidden one outside the list is
described so that fresh tests are predicted better."""

from __future__ import annotations

import shlex
from itertools import combinations
from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest
from support.compiled_pad import STRICT, CompiledPad, needs_gcc
from support.exported_pad import described, exported, reference
from support.lawmotions import retracting

from qlvbayes.diagnosis.description.grammar import grammar
from qlvbayes.diagnosis.description.source import (
    ADDED_BY,
    References,
    formula_of,
    load,
    name_of,
    source_of,
)
from qlvbayes.diagnosis.result import LawPair
from qlvbayes.diagnosis.summary.diagnosis import Diagnosis, DiagnosisWork
from qlvbayes.effects.catalogue import EVERY, own_effects
from qlvbayes.effects.conformance import check_effect
from qlvbayes.io.units import PAD, STRAIN
from qlvbayes.laws.elastic.exponential import Exponential
from qlvbayes.laws.layered import Law
from qlvbayes.laws.motion import Motion
from qlvbayes.laws.relaxation.prony import Prony
from qlvbayes.use.exports.code import CHeader

REFERENCES = References(1.6, 100.0, 1000.0, 1.5, 500.0)
TERMS = {term.name: term for term in grammar()}


PAIRS = (
    ("factor_of_remembered_elastic_force", "power_drag_of_depth_squared"),
    ("shift_of_remembered_speed", "factor_of_clock"),
)


def _source(*names: str) -> str:
    return source_of([TERMS[name] for name in names], REFERENCES, PAD, "It describes tests.")


@pytest.mark.parametrize("name", sorted(TERMS))
@pytest.mark.few(2)  # the pairs below have two of each other way to enter, with states
def test_every_term_keeps_the_rules_of_effects(name: str) -> None:
    check_effect(load(_source(name)))


@pytest.mark.parametrize("names", PAIRS)
@pytest.mark.few(1)
def test_pairs_keep_the_rules_of_effects(names: tuple[str, str]) -> None:
    assert TERMS[names[0]].joins(TERMS[names[1]])
    check_effect(load(_source(*names)))


def test_pairs_that_join_are_python_and_formulas_say_what_their_letters_are():
    assert not TERMS["rig_linear_drag"].joins(TERMS["linear_drag_of_depth"])
    assert not TERMS["shift_of_remembered_depth"].joins(TERMS["linear_drag"])
    assert not set(TERMS) & {kind.name for kind in EVERY}
    for first, second in list(combinations(TERMS.values(), 2))[::5]:
        if first.joins(second):
            compile(source_of([first, second], REFERENCES, PAD, "."), "law", "exec")
    formula = formula_of([TERMS["power_drag_of_depth_squared"]], REFERENCES, PAD)
    assert formula == "F += k d^2 |v|^n sgn v (with d = depth/(1.6 mm), v = velocity/(100 mm/s))"
    strain = formula_of([TERMS["linear_drag_of_depth"]], REFERENCES, STRAIN)
    assert strain == "F += k d v (with d = strain/(1.6), v = velocity/(100 1/s))"


def test_a_file_is_read_as_a_users_own_effect(tmp_path) -> None:
    path = tmp_path / "described_effect.py"
    path.write_text(_source(*PAIRS[0]), encoding="utf-8")
    (kind,) = own_effects(path)
    assert kind.name == name_of([TERMS[name] for name in PAIRS[0]])
    assert set(kind.null) == {"k1", "k2"}


def test_the_command_in_a_laws_file_is_that_of_the_diagnosis_and_names_the_users_files():
    """The law was found beside effects and on laws that the command therefore names too."""
    law = SimpleNamespace(base=LawPair("hertz", "prony:2"), effects=("friction",), effect="drag")
    result = SimpleNamespace(
        description=law, stages=[SimpleNamespace(effects=())], forms={}, units=PAD
    )
    space = SimpleNamespace(bonded=False)
    search = SimpleNamespace(density=SimpleNamespace(space=space))
    text = f"Add it with\n\n    {ADDED_BY}\n"
    work = DiagnosisWork(None, search, None, (), SimpleNamespace(text=text))
    typed = "pads.csv", "my results", "my results/B/described_effect.py"
    found = Diagnosis(result, work).typed(*typed)
    written = found.law_file
    assert shlex.split(written)[3:] == [
        *("qlvbayes", "fit", "pads.csv", "-o", "my results", "--all-tests"),
        *("--effects-file", "my results/B/described_effect.py", "--elastic", "hertz"),
        *("--add", "friction", "--add", "drag"),
    ]
    assert found.work.typed.design == "qlvbayes design 'my results' --for cause"


def test_forces_on_many_sets_are_those_of_each() -> None:
    time = np.linspace(0.0, 4.0, 81)
    depth = 1.5 * np.sin(time) ** 2
    columns = [x[:, None, None] for x in (time, depth, np.gradient(depth, time), 0.0 * time)]
    motion = Motion(*columns, start=np.zeros((1, 1)))
    law = Law(Exponential(0.34, 1.1), Prony(np.array([0.4, 0.6]), np.array([2.0])))
    kind = load(_source(*PAIRS[0]))
    sets = np.array([[0.1, 2.0, 0.3, 0.5], [0.0, 1.0, 0.0, 1.0], [-0.1, 5.0, 0.2, 1.5]])
    together = kind(*sets.T).force(law, motion)
    for k, own in enumerate(sets):
        alone = kind(*(own[:, None])).force(law, motion)
        np.testing.assert_allclose(together[:, :, k], alone[:, :, 0], rtol=1e-12)
    np.testing.assert_allclose(together[:, :, 1], law.force(motion)[:, :, 0], rtol=1e-12)


@needs_gcc
@pytest.mark.parametrize(
    "names",
    [*PAIRS, ("force_of_remembered_largest_depth",)],
)
def test_the_exported_header_has_the_law(tmp_path, names: tuple[str, ...]) -> None:
    choices = described(tmp_path, *names)
    pad = exported(tmp_path, choices, spread=0.0)
    program = CompiledPad(tmp_path / "c", CHeader().files(pad, None), flags=(*STRICT, "-DONE_WAY"))
    time, depth = retracting()
    speed = np.concatenate([[0.0], np.diff(depth) / np.diff(time)])
    motion = Motion(*map(jnp.asarray, (time, depth, speed, np.zeros_like(time))))
    expected = np.asarray(reference(choices).force(motion))
    force, _ = program.force(time, depth)
    assert np.max(np.abs(force - expected)) <= 1e-10 * np.max(np.abs(expected))
