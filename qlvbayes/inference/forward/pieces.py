r"""What a layer does to the motion and to the force beneath it, as compiled functions of its own.

A layer is written as one statement, ``force(below, motion)``. Here it is traced with a stand-in for
the law beneath: all up to its first question to that is one piece, all up to the next question
another one, and the last piece makes the force of the answers,

.. math:: m_1 = p_0(m), \quad m_2 = p_1(m, F_1), \ldots \quad F = p_n(m, F_1, \ldots, F_n).

A piece acts on all tests T and sets of constants K together, and knows nothing of what lies beneath
or above it: a hypothesis is a chain of calls, and what it has not got costs nothing.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array

from qlvbayes.io.executables import Executables
from qlvbayes.laws.elastic.law import AbstractElastic
from qlvbayes.laws.hereditary import hereditary_force
from qlvbayes.laws.layered import Law, Layer
from qlvbayes.laws.motion import Motion
from qlvbayes.laws.relaxation.law import AbstractRelaxation
from qlvbayes.laws.relaxation.spectrum import Spectrum

# LLVM's costly passes take half of the time to compile, and what they gain cannot be measured.
# XLA's newer emitters take as much again; they make the material's recursion a quarter faster.
_QUICK = {"xla_llvm_disable_expensive_passes": True}
_QUICKEST = {**_QUICK, "xla_cpu_use_fusion_emitters": False}
_PACKAGE = Path(__file__).parents[2]
# What the source of a piece lies in, and all of the package that is imported there.
MADE_OF = (
    "laws",
    "effects",
    "priors",
    "io/checks.py",
    "io/escaping.py",
    "io/units.py",
    "io/usermodule.py",
    "inference/forward/pieces.py",
)
_POINTS = 8  # of the motion on which it is seen what a layer asks for: any number would do


class _AskedError(Exception):
    """A layer asks for a force that is not known yet."""


class _Beneath:
    """Stands for the law beneath a layer: gives the answers known, and keeps what is asked."""

    def __init__(self, elastic: Any, relaxation: Any, answers: Sequence[Array]) -> None:
        self._elastic, self._relaxation, self._answers = elastic, relaxation, answers
        self.asked: list[Motion] = []
        self.is_looked_at = False

    @property
    def elastic(self) -> AbstractElastic:
        """The material's elastic law."""
        self.is_looked_at = True
        return self._elastic

    @property
    def relaxation(self) -> AbstractRelaxation:
        """The material's relaxation."""
        self.is_looked_at = True
        return self._relaxation

    def force(self, motion: Motion) -> Array:
        """The answer, if it is known."""
        self.asked.append(motion)
        if len(self.asked) > len(self._answers):
            raise _AskedError
        return self._answers[len(self.asked) - 1]


@dataclass(frozen=True, eq=False)
class Question:
    """What a layer asks of the law beneath: a motion, by its structure, with some leaves changed.

    new: which leaves of the motion are not those of the motion above.
    """

    structure: Any
    new: tuple[bool, ...]


@dataclass(frozen=True, eq=False)
class Plan:
    """A layer's questions in turn, and whether it looks at the material's own laws."""

    questions: tuple[Question, ...]
    is_looking: bool


@cache
def plan_of(layer: Any, elastic: Any, of_motion: Any) -> Plan | None:
    """Of a layer over an elastic law under a motion, each given by its structure.

    None where the layer runs the law beneath in a loop or a derivative of its own, which cannot be
    cut into pieces.
    """
    questions: list[Question] = []
    answers: list[jax.ShapeDtypeStruct] = []
    looking = False
    while True:
        seen: list[tuple[Question | None, bool]] = []
        ask = partial(_question, layer, elastic, of_motion, seen)
        try:
            trace = jax.make_jaxpr(ask, return_shape=True)
            traced, shapes = trace(_zeros(layer), _zeros(elastic), _dummy(of_motion), answers)
        except (jax.errors.JAXTypeError, jax.errors.UnexpectedTracerError):
            return None
        if any(isinstance(constant, jax.core.Tracer) for constant in traced.consts):
            return None  # what is asked for comes about inside a loop
        question, looks = seen[-1]
        looking |= looks
        if question is None:
            return Plan(tuple(questions), looking)
        questions.append(question)
        points = jax.tree.unflatten(question.structure, shapes).time.shape
        answers.append(jax.ShapeDtypeStruct(points, float))


def _question(
    layer: Any,
    elastic: Any,
    of_motion: Any,
    seen: list[tuple[Question | None, bool]],
    own: Any,
    law: Any,
    motion: Motion,
    answers: Sequence[Array],
) -> list[Array]:
    """Leaves of the motion first asked for beyond some answers; it tells ``seen`` of them."""
    spectrum = Spectrum(jnp.zeros(3), jnp.zeros(2))
    beneath = _Beneath(jax.tree.unflatten(elastic, law), spectrum, answers)
    whole: Layer = jax.tree.unflatten(layer, own)
    with suppress(_AskedError):
        force = whole.force(beneath, motion)  # type: ignore[arg-type]
        seen.append((None, beneath.is_looked_at))
        return [force]
    leaves, structure = jax.tree.flatten(beneath.asked[-1])
    old = jax.tree.leaves(motion) if structure == of_motion else leaves
    new = tuple(
        structure != of_motion or leaf is not other for leaf, other in zip(leaves, old, strict=True)
    )
    seen.append((Question(structure, new), beneath.is_looked_at))
    return leaves


def _zeros(structure: Any) -> list[Array]:
    return [jnp.zeros(())] * structure.num_leaves


def _dummy(of_motion: Any) -> Motion:
    """Any motion of a structure."""
    like: Motion = jax.tree.unflatten(of_motion, [0] * of_motion.num_leaves)
    time = jnp.arange(float(_POINTS))
    ago = None if like.ago is None else jnp.zeros(_POINTS, int)
    return Motion(time, time, time, time, ago=ago, bow=None if like.bow is None else time)


@cache
def piece_of(
    layer: Any,
    elastic: Any,
    of_motion: Any,
    turn: int,
    alike: tuple[bool, ...],
    new: tuple[bool, ...] = (),
) -> Callable[..., Any]:
    """The compiled piece of a layer before its question ``turn``, or after the last answer.

    elastic: None where the layer does not look at the laws; alike: which leaves of the motion are
    the same for all sets, (T, N) and not (T, K, N); new: of the question.
    Its arguments: the layer's constants (K, P); the elastic law's constants (K, E), fractions
    (K, L + 1) and rates (K, L), or nothing where the layer does not look at them; the leaves of the
    motion; the answers so far, (T, K, N). It gives the new leaves, or the force (T, K, N).
    """

    def one(own: Array, laws: Any, leaves: Sequence[Array], answers: Sequence[Array]) -> Any:
        law, relaxation = None, None
        if laws:
            law, relaxation = jax.tree.unflatten(elastic, list(laws[0])), Spectrum(*laws[1:])
        return done(own, _Beneath(law, relaxation, answers), leaves)

    done = partial(_done, layer, of_motion, new)
    axes = _axes(alike)
    over = _over_all(one, (0, 0, axes, 0), (None, None, 0, 0))
    return _compiled(over, (layer, elastic), ("piece", of_motion, turn, alike, new))


@cache
def common_piece_of(layer: Any, of_motion: Any, new: tuple[bool, ...]) -> Callable[..., Any]:
    """The first piece of a layer without constants, under a motion that all sets have: (T, N)."""

    def one(leaves: Sequence[Array]) -> Any:
        return _done(layer, of_motion, new, (), _Beneath(None, None, ()), leaves)

    return _compiled(jax.vmap(one), (layer,), ("common", of_motion, new))


def _done(
    layer: Any,
    of_motion: Any,
    new: tuple[bool, ...],
    own: Any,
    beneath: _Beneath,
    leaves: Sequence[Array],
) -> Any:
    """New leaves of the motion that a layer asks for beyond the answers known, or its force."""
    whole: Layer = jax.tree.unflatten(layer, list(own))
    with suppress(_AskedError):
        motion = jax.tree.unflatten(of_motion, leaves)
        return whole.force(beneath, motion)  # type: ignore[arg-type]
    asked = jax.tree.leaves(beneath.asked[-1])
    return [leaf for leaf, is_new in zip(asked, new, strict=True) if is_new]


@cache
def whole_of(
    layers: tuple[Any, ...], elastic: Any, of_motion: Any, alike: tuple[bool, ...]
) -> Callable[..., Array]:
    """The compiled force of a law under layers that cannot be cut into pieces, (T, K, N).

    Its arguments are those of `piece_of`, with each layer's constants and without answers.
    """

    def one(owns: Sequence[Array], laws: Any, leaves: Sequence[Array]) -> Array:
        own = tuple(jax.tree.unflatten(s, list(own)) for s, own in zip(layers, owns, strict=True))
        law, relaxation = jax.tree.unflatten(elastic, list(laws[0])), Spectrum(*laws[1:])
        return Law(law, relaxation, own).force(jax.tree.unflatten(of_motion, leaves))

    axes = _axes(alike)
    over = _over_all(one, (0, 0, axes), (None, None, 0))
    return _compiled(over, (*layers, elastic), ("whole", of_motion, alike))


@cache
def material_of(elastic: Any, rates: bool, path: tuple[bool, bool, bool]) -> Callable[..., Array]:
    """The compiled force of the material alone, (T, K, N).

    Of the elastic law's constants (K, E), fractions (K, L + 1), rates (K, L), time, depth and bow
    (T, K, N). rates: whether all sets have the same, (L,); path: the same of time, depth and bow,
    which are (T, N) then.
    """

    def one(
        law: Array, fractions: Array, rates: Array, time: Array, depth: Array, bow: Array
    ) -> Array:
        spectrum = Spectrum(fractions, rates)
        return hereditary_force(jax.tree.unflatten(elastic, list(law)), spectrum, time, depth, bow)

    inner = (0, 0, *_axes((rates, *path)))
    over = _over_all(one, inner, (None, None, None, 0, 0, 0))
    return _compiled(over, (elastic,), ("material", rates, path), _QUICK)


def _axes(alike: Sequence[bool]) -> tuple[int | None, ...]:
    """Over which axis sets lie, none where all have the same."""
    return tuple(None if same else 0 for same in alike)


def _over_all(one: Callable[..., Any], sets: Any, tests: Any) -> Callable[..., Any]:
    """Over sets of constants within tests."""
    return jax.vmap(jax.vmap(one, in_axes=sets), in_axes=tests)


def _compiled(
    function: Callable[..., Any],
    parts: Sequence[Any],
    meaning: Sequence[Any],
    options: dict[str, bool] = _QUICKEST,
) -> Executables:
    """A function, compiled; parts: structures of the laws and effects in it, as far as there are.

    meaning: all else that it is made of.
    """
    known = {name: value for name, value in options.items() if name in _known_options()}
    kinds = [part.node_data()[0] for part in parts if part is not None]
    ours = all(
        kind.__module__.startswith(("qlvbayes.laws.", "qlvbayes.effects.")) for kind in kinds
    )
    names = [f"{kind.__module__}.{kind.__qualname__}" for kind in kinds]
    text = f"{names} {[str(part) for part in parts]} {[str(one) for one in meaning]} {_source()}"
    return Executables(function, known, text if ours else None)


@cache
def _source() -> str:
    """A digest of the source that pieces are made of: an edit elsewhere compiles nothing again."""
    digest = hashlib.sha256()
    for made_of in MADE_OF:
        path = _PACKAGE / made_of
        for file in sorted(path.rglob("*.py")) if path.is_dir() else [path]:
            digest.update(f"{file.relative_to(_PACKAGE)} ".encode() + file.read_bytes())
    return digest.hexdigest()


@cache
def _known_options() -> frozenset[str]:
    """Those that this XLA knows: options come and go with its versions."""
    found = set()
    for name, value in _QUICKEST.items():
        with suppress(jax.errors.JaxRuntimeError):
            jax.jit(lambda x: x, compiler_options={name: value}).lower(0.0).compile()
            found.add(name)
    return frozenset(found)
