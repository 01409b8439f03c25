r"""Compile what a layer does to the motion and to the force beneath it, piece by piece.

A layer is written as one function, ``force(below, motion)``. Here it is traced with a stand-in for
the law beneath. All that happens up to its first request for that law's force is one piece, all up
to the next request another one, and the last piece computes the force from the answers,

.. math:: m_1 = p_0(m), \quad m_2 = p_1(m, F_1), \ldots \quad F = p_n(m, F_1, \ldots, F_n).

A piece acts on all tests T and sets of constants K together, and depends on nothing beneath or
above it. A hypothesis is a chain of such calls, and layers that it lacks cost nothing.
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
from qlvbayes.laws.hereditary import hereditary_force, hereditary_parts
from qlvbayes.laws.layered import Law, Layer
from qlvbayes.laws.motion import Motion
from qlvbayes.laws.relaxation.law import AbstractRelaxation
from qlvbayes.laws.relaxation.spectrum import Spectrum

# LLVM's expensive passes take half of the compilation time and speed up nothing measurably. XLA's
# newer emitters take as long again; they speed up the material's recursion by a quarter.
_QUICK = {"xla_llvm_disable_expensive_passes": True}
_QUICKEST = {**_QUICK, "xla_cpu_use_fusion_emitters": False}
_PACKAGE = Path(__file__).parents[2]
# The source of the pieces, and all of the package that is imported there.
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
_POINTS = 8  # of the motion on which a layer is traced: any number would do


class _UnansweredError(Exception):
    """Exception for a layer that requests a force that is not known yet."""


class _LawBeneath:
    """A stand-in for the law beneath a layer: it returns known answers and records requests."""

    def __init__(self, elastic: Any, relaxation: Any, answers: Sequence[Array]) -> None:
        self._elastic, self._relaxation, self._answers = elastic, relaxation, answers
        self.requested: list[Motion] = []
        self.uses_laws = False

    @property
    def elastic(self) -> AbstractElastic:
        """Return the material's elastic law."""
        self.uses_laws = True
        return self._elastic

    @property
    def relaxation(self) -> AbstractRelaxation:
        """Return the material's relaxation."""
        self.uses_laws = True
        return self._relaxation

    def force(self, motion: Motion) -> Array:
        """Return the answer to a request for the force of a motion, if it is known."""
        self.requested.append(motion)
        if len(self.requested) > len(self._answers):
            raise _UnansweredError
        return self._answers[len(self.requested) - 1]


@dataclass(frozen=True, eq=False)
class MotionRequest:
    """A motion of which a layer requests the force, given by its structure."""

    structure: Any
    new: tuple[bool, ...]  # which of its leaves differ from those of the motion above


@dataclass(frozen=True, eq=False)
class LayerPlan:
    """The requests of a layer in order, and whether it uses the material's own laws."""

    requests: tuple[MotionRequest, ...]
    uses_laws: bool


@cache
def plan_of(layer: Any, elastic: Any, motion_structure: Any) -> LayerPlan | None:
    """Return the plan of a layer over an elastic law under a motion, each by its structure."""
    requests: list[MotionRequest] = []
    answers: list[jax.ShapeDtypeStruct] = []
    any_uses_laws = False
    while True:
        outcomes: list[tuple[MotionRequest | None, bool]] = []
        trace_request = partial(_first_request, layer, elastic, motion_structure, outcomes)
        try:
            trace = jax.make_jaxpr(trace_request, return_shape=True)
            traced, shapes = trace(
                _zeros(layer), _zeros(elastic), _dummy(motion_structure), answers
            )
        except (jax.errors.JAXTypeError, jax.errors.UnexpectedTracerError):
            return None
        if any(isinstance(constant, jax.core.Tracer) for constant in traced.consts):
            return None  # the request is made inside a loop
        request, uses_laws = outcomes[-1]
        any_uses_laws |= uses_laws
        if request is None:
            return LayerPlan(tuple(requests), any_uses_laws)
        requests.append(request)
        points = jax.tree.unflatten(request.structure, shapes).time.shape
        answers.append(jax.ShapeDtypeStruct(points, float))


def _first_request(
    layer: Any,
    elastic: Any,
    motion_structure: Any,
    outcomes: list[tuple[MotionRequest | None, bool]],
    constants: Any,
    law: Any,
    motion: Motion,
    answers: Sequence[Array],
) -> list[Array]:
    """Return the leaves of the first requested motion that is not answered yet, or the force."""
    spectrum = Spectrum(jnp.zeros(3), jnp.zeros(2))
    beneath = _LawBeneath(jax.tree.unflatten(elastic, law), spectrum, answers)
    instance: Layer = jax.tree.unflatten(layer, constants)
    with suppress(_UnansweredError):
        force = instance.force(beneath, motion)  # type: ignore[arg-type]
        outcomes.append((None, beneath.uses_laws))
        return [force]
    leaves, structure = jax.tree.flatten(beneath.requested[-1])
    old = jax.tree.leaves(motion) if structure == motion_structure else leaves
    new = tuple(
        structure != motion_structure or leaf is not other
        for leaf, other in zip(leaves, old, strict=True)
    )
    outcomes.append((MotionRequest(structure, new), beneath.uses_laws))
    return leaves


def _zeros(structure: Any) -> list[Array]:
    """Return a zero for each leaf of a structure."""
    return [jnp.zeros(())] * structure.num_leaves


def _dummy(motion_structure: Any) -> Motion:
    """Return some motion of a structure."""
    like: Motion = jax.tree.unflatten(motion_structure, [0] * motion_structure.num_leaves)
    time = jnp.arange(float(_POINTS))
    ago = None if like.ago is None else jnp.zeros(_POINTS, int)
    return Motion(time, time, time, time, ago=ago, sagitta=None if like.sagitta is None else time)


@cache
def piece_of(
    layer: Any,
    elastic: Any,
    motion_structure: Any,
    turn: int,
    shared: tuple[bool, ...],
    new: tuple[bool, ...] = (),
) -> Callable[..., Any]:
    """Return a layer's compiled piece before its request ``turn``, or after the last answer."""

    def one(constants: Array, laws: Any, leaves: Sequence[Array], answers: Sequence[Array]) -> Any:
        law, relaxation = None, None
        if laws:
            law, relaxation = jax.tree.unflatten(elastic, list(laws[0])), Spectrum(*laws[1:])
        return evaluate(constants, _LawBeneath(law, relaxation, answers), leaves)

    evaluate = partial(_evaluated, layer, motion_structure, new)
    axes = _axes(shared)
    batched = _over_all(one, (0, 0, axes, 0), (None, None, 0, 0))
    return _compiled(batched, (layer, elastic), ("piece", motion_structure, turn, shared, new))


@cache
def common_piece_of(layer: Any, motion_structure: Any, new: tuple[bool, ...]) -> Callable[..., Any]:
    """Return the first piece of a layer without constants, for a motion (T, N) of all sets."""

    def one(leaves: Sequence[Array]) -> Any:
        return _evaluated(layer, motion_structure, new, (), _LawBeneath(None, None, ()), leaves)

    return _compiled(jax.vmap(one), (layer,), ("common", motion_structure, new))


def _evaluated(
    layer: Any,
    motion_structure: Any,
    new: tuple[bool, ...],
    constants: Any,
    beneath: _LawBeneath,
    leaves: Sequence[Array],
) -> Any:
    """Return the new leaves of the motion requested beyond the known answers, or the force."""
    instance: Layer = jax.tree.unflatten(layer, list(constants))
    with suppress(_UnansweredError):
        motion = jax.tree.unflatten(motion_structure, leaves)
        return instance.force(beneath, motion)  # type: ignore[arg-type]
    requested = jax.tree.leaves(beneath.requested[-1])
    return [leaf for leaf, is_new in zip(requested, new, strict=True) if is_new]


@cache
def whole_of(
    layers: tuple[Any, ...], elastic: Any, motion_structure: Any, shared: tuple[bool, ...]
) -> Callable[..., Array]:
    """Return the compiled force (T, K, N) of a law under layers that cannot be cut into pieces."""

    def one(constants: Sequence[Array], laws: Any, leaves: Sequence[Array]) -> Array:
        values = tuple(
            jax.tree.unflatten(s, list(values)) for s, values in zip(layers, constants, strict=True)
        )
        law, relaxation = jax.tree.unflatten(elastic, list(laws[0])), Spectrum(*laws[1:])
        return Law(law, relaxation, values).force(jax.tree.unflatten(motion_structure, leaves))

    axes = _axes(shared)
    batched = _over_all(one, (0, 0, axes), (None, None, 0))
    return _compiled(batched, (*layers, elastic), ("whole", motion_structure, shared))


@cache
def material_of(elastic: Any, rates: bool, path: tuple[bool, bool, bool]) -> Callable[..., Array]:
    """Return the compiled force (T, K, N) of the material alone."""

    def one(
        law: Array, fractions: Array, rates: Array, time: Array, depth: Array, sagitta: Array
    ) -> Array:
        spectrum = Spectrum(fractions, rates)
        return hereditary_force(
            jax.tree.unflatten(elastic, list(law)), spectrum, time, depth, sagitta
        )

    inner = (0, 0, *_axes((rates, *path)))
    batched = _over_all(one, inner, (None, None, None, 0, 0, 0))
    return _compiled(batched, (elastic,), ("material", rates, path), _QUICK)


@cache
def parts_of(elastic: Any, path: tuple[bool, bool, bool]) -> Callable[..., Array]:
    """Return the compiled parts (T, K, L + 1, N) of the material's force (`hereditary_parts`)."""

    def one(law: Array, rates: Array, time: Array, depth: Array, sagitta: Array) -> Array:
        return hereditary_parts(jax.tree.unflatten(elastic, list(law)), rates, time, depth, sagitta)

    batched = _over_all(one, (0, None, *_axes(path)), (None, None, 0, 0, 0))
    return _compiled(batched, (elastic,), ("parts", path), _QUICK)


def _axes(shared: Sequence[bool]) -> tuple[int | None, ...]:
    """Return the axis of the sets for each argument, None where all sets share it."""
    return tuple(None if same else 0 for same in shared)


def _over_all(one: Callable[..., Any], sets: Any, tests: Any) -> Callable[..., Any]:
    """Return a function mapped over sets of constants within tests."""
    return jax.vmap(jax.vmap(one, in_axes=sets), in_axes=tests)


def _compiled(
    function: Callable[..., Any],
    parts: Sequence[Any],
    meaning: Sequence[Any],
    options: dict[str, bool] = _QUICKEST,
) -> Executables:
    """Return a function in compiled form."""
    options_known = {name: value for name, value in options.items() if name in _known_options()}
    kinds = [part.node_data()[0] for part in parts if part is not None]
    in_package = all(
        kind.__module__.startswith(("qlvbayes.laws.", "qlvbayes.effects.")) for kind in kinds
    )
    names = [f"{kind.__module__}.{kind.__qualname__}" for kind in kinds]
    text = f"{names} {[str(part) for part in parts]} {[str(one) for one in meaning]} {_source()}"
    return Executables(function, options_known, text if in_package else None)


@cache
def _source() -> str:
    """Return a digest of the source of all pieces: an edit elsewhere recompiles nothing."""
    digest = hashlib.sha256()
    for made_of in MADE_OF:
        path = _PACKAGE / made_of
        for file in sorted(path.rglob("*.py")) if path.is_dir() else [path]:
            digest.update(f"{file.relative_to(_PACKAGE)} ".encode() + file.read_bytes())
    return digest.hexdigest()


@cache
def _known_options() -> frozenset[str]:
    """Return the options that this version of XLA knows: they come and go."""
    known = set()
    for name, value in _QUICKEST.items():
        with suppress(jax.errors.JaxRuntimeError):
            jax.jit(lambda x: x, compiler_options={name: value}).lower(0.0).compile()
            known.add(name)
    return frozenset(known)
