"""The elastic law and the layers of a model as expressions, for other languages.

An effect defines in `begin` and `step` how it continues along each line of a motion, an elastic law
in `force`, `stiffness` and `relaxed_step`. These methods themselves are translated, not a second
description: each is run once on expressions, in which the law beneath a layer is two calls.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import ShapedArray
from jax.extend import core

from qlvbayes.effects.effect import AbstractEffect, Level
from qlvbayes.effects.sensors import ChannelLag
from qlvbayes.laws.elastic.law import AbstractElastic
from qlvbayes.laws.layered import Contact, Layer
from qlvbayes.laws.motion import Line
from qlvbayes.model.model import Model
from qlvbayes.model.parameters import fields_of
from qlvbayes.model.stepping import without_steps
from qlvbayes.use.exports.expressions import Expression, Expressions, TranslationError

LINE = ("h", "to", "speed", "clear")
"""A line's duration (s), end, speed, and how far it then is off the specimen."""
_MOST = 64  # scalars in a layer's memory, each of which is written out

_STATE = np.uint8  # stands for a state of the law beneath
_LENGTH = "displacement"


@dataclass(frozen=True, eq=False)
class LayerComputation:
    """The results of a layer's `begin` or `step`, as expressions.

    states: of the law beneath; memory: the layer's own; force: None of `begin`, which has none.
    """

    states: tuple[Expression, ...]
    memory: tuple[Expression, ...]
    force: Expression | None

    @property
    def results(self) -> tuple[Expression, ...]:
        """Expressions that are computed."""
        return (*self.states, *self.memory, *((self.force,) if self.force else ()))

    @cached_property
    def used(self) -> dict[int, int]:
        """Number of uses of each expression, by its id."""
        count: dict[int, int] = {}
        for x in self.ordered:
            for arg in x.args:
                count[id(arg)] = count.get(id(arg), 0) + 1
        for x in self.results:
            count[id(x)] = count.get(id(x), 0) + 1
        return count

    @cached_property
    def ordered(self) -> tuple[Expression, ...]:
        """Expressions in the order of evaluation, each after its arguments."""
        known: dict[int, Expression] = {}

        def visit(x: Expression) -> None:
            if id(x) not in known:
                for arg in x.args:
                    visit(arg)
                known[id(x)] = x

        for x in self.results:
            visit(x)
        return tuple(known.values())


@dataclass(frozen=True, eq=False)
class ExportedLayer:
    """One layer, as a language writes it.

    name: part of an identifier; formula: the law in one line; columns: names of the constants in a
    posterior; touch: index in its memory of the flag that the specimen is touched, None where it
    has none; inverts: as of the effect; late: whether it reads the force of an earlier time, for
    which languages have a queue of lines, not ``begin`` and ``step``.
    """

    name: str
    formula: str
    columns: tuple[str, ...]
    begin: LayerComputation
    step: LayerComputation
    touch: int | None = None
    inverts: bool = True
    late: bool = False

    @property
    def constants(self) -> tuple[str, ...]:
        """Names of the columns as identifiers."""
        return tuple(_identifier(name) for name in self.columns)

    @property
    def memory(self) -> int:
        """Number of scalars in its memory."""
        return len(self.step.memory)

    @property
    def beneath(self) -> int:
        """Number of states of the layer beneath that it keeps."""
        return len(self.step.states)


@dataclass(frozen=True, eq=False)
class ElasticFunction:
    """One function of the elastic law: its name, arguments besides the constants, and value."""

    name: str
    summary: str
    arguments: tuple[str, ...]
    work: LayerComputation


_STEP_OF_MODE = ("start", "stop", "at_start", "at_stop", "decay", "left")
"""Depths and elastic forces at both ends of a step, v h of the mode, and e^{-decay}."""


def elastic_functions(law: AbstractElastic) -> list[ElasticFunction]:
    """Return the elastic force, the stiffness, and the step of a relaxing mode."""
    make = Expressions({})
    names = tuple(type(law).units)
    constants = [make.named("constant_of", name) for name in names]
    number = jax.ShapeDtypeStruct((), float)

    def of(values: Sequence[Any]) -> Any:
        return eqx.tree_at(lambda one: [getattr(one, name) for name in names], law, values)

    def step(
        values: Sequence[Any], start: Any, stop: Any, first: Any, last: Any, decay: Any
    ) -> Any:
        return of(values).relaxed_step(start, stop, first, last, decay)

    ways = (
        ("elastic_force", "The elastic force at a depth.", ("depth",),
         lambda values, depth: of(values).force(depth)),
        ("stiffness", "Its slope.", ("depth",), lambda values, depth: of(values).stiffness(depth)),
        ("step", "Integral of e^{-v (h - s)} K d(depth) over a step.", _STEP_OF_MODE, step),
    )  # fmt: skip
    functions = []
    for name, summary, arguments, function in ways:
        traced = [argument for argument in arguments if argument != "left"]
        program = jax.make_jaxpr(function)([number] * len(names), *[number] * len(traced))
        given = {argument: make.named("line", argument) for argument in arguments}
        if "left" in given:
            make.equate(make.call("exp", make.call("neg", given["decay"])), given["left"])
        (value,) = make.from_program(program, [*constants, *(given[x] for x in traced)])
        functions.append(ElasticFunction(name, summary, arguments, LayerComputation((), (), value)))
    return functions


def exported_layers(model: Model) -> tuple[tuple[ExportedLayer, ...], dict[str, str]]:
    """Return the layers that can be written out, innermost first, and why others cannot."""
    lost = without_steps(model)
    pieces: list[ExportedLayer] = []
    for layer in model.law.layers:
        name = getattr(layer, "name", "contact")
        if name in lost or in_spectrum(layer, model):
            continue
        try:
            pieces.append(piece_of(layer))
        except TranslationError as reason:
            lost[name] = str(reason)
    return tuple(pieces), lost


def in_spectrum(layer: Layer, model: Model) -> bool:
    """Return whether a layer only changes the relaxation."""
    return isinstance(layer, AbstractEffect) and changed(layer, model) is not None


def changed(effect: AbstractEffect, model: Model) -> Any:
    """Return what an effect makes of the relaxation's fractions and rates."""
    return jax.eval_shape(lambda law: effect.spectrum(*law.spectrum()), model.relaxation)


def piece_of(layer: Layer) -> ExportedLayer:
    """Return a layer's begin and step as expressions."""
    make = Expressions(_CALLS)
    if not isinstance(layer, AbstractEffect):
        return _contact(make)
    columns = tuple(name for field in fields_of(layer) for name in field.names)
    formula = " ".join(layer.law.split())
    if isinstance(layer, ChannelLag):
        before = make.named("state", 0)
        begin, step = LayerComputation((before,), (), None), LayerComputation((before,), (), before)
        return ExportedLayer(layer.name, formula, columns, begin, step, inverts=False, late=True)
    constants = [make.named("constant_of", _identifier(name)) for name in columns]
    begin, step = _traced(layer, make, constants)
    if touches := layer.level == Level.CONTACT:
        begin, step = _with_touch(make, begin, step)
    touch = len(step.memory) - 1 if touches else None
    name = _identifier(layer.name)
    name = f"{name}_effect" if name in ("contact", "material") else name
    return ExportedLayer(name, formula, columns, begin, step, touch, layer.inverts)


def _contact(make: Expressions) -> ExportedLayer:
    """Return contact, with the force that it has where steps follow it beyond its loss."""
    begin, free = _with_touch(make, *_traced(Contact(), make, []))
    _, followed = _traced(Contact(followed=True), make, [])
    assert free.force is not None
    assert followed.force is not None
    force = make.either(make.named("line", "followed"), followed.force, free.force)
    step = LayerComputation(free.states, free.memory, force)
    formula = "a loose specimen has no depth below 0, and its force is never negative"
    return ExportedLayer("contact", formula, (), begin, step, touch=0)


def _with_touch(
    make: Expressions, begin: LayerComputation, step: LayerComputation
) -> tuple[LayerComputation, LayerComputation]:
    """Return a layer with one more scalar in memory: 1 where the specimen is touched, else 0."""
    assert step.force is not None
    zero = make.constant(0.0)
    pressed = make.call("gt", make.named("line", "to"), zero)
    touched = make.call("and", pressed, make.call("ne", step.force, zero))
    memory = (*step.memory, make.either(touched, make.constant(1.0), zero))
    return (
        LayerComputation(begin.states, (*begin.memory, zero), None),
        LayerComputation(step.states, memory, step.force),
    )


def _traced(
    layer: Layer, make: Expressions, constants: list[Expression]
) -> tuple[LayerComputation, LayerComputation]:
    leaves, shape = jax.tree.flatten(layer)
    sizes = [jax.ShapeDtypeStruct(np.shape(leaf), float) for leaf in leaves]
    number = jax.ShapeDtypeStruct((), float)
    state_shape = None

    def begins(values, displacement):  # type: ignore[no-untyped-def]
        nonlocal state_shape
        state = jax.tree.unflatten(shape, values).begin(_Beneath(), displacement)
        parts, state_shape = jax.tree.flatten(state)
        return parts

    def goes_on(values, parts, line):  # type: ignore[no-untyped-def]
        state = jax.tree.unflatten(state_shape, parts)
        given = Line(*line)
        state, force = jax.tree.unflatten(shape, values).step(_Beneath(), state, given)
        return jax.tree.leaves(state), force

    begun, kept = jax.make_jaxpr(begins, return_shape=True)(sizes, number)
    if (count := sum(np.prod(x.shape, dtype=int) for x in kept)) > _MOST:
        raise TranslationError(f"it remembers {count} numbers, more than are written out")
    stepped = jax.make_jaxpr(goes_on)(sizes, kept, [number] * len(LINE))
    parts = list(_named(kept, make))
    line = [make.named("line", name) for name in LINE]
    first = make.from_program(begun, [*constants, make.named("line", _LENGTH)])
    *after, force = make.from_program(stepped, [*constants, *parts, *line])
    return LayerComputation(*_sorted(first, kept), None), LayerComputation(
        *_sorted(after, kept), force
    )


def _named(kept: list[Any], make: Expressions) -> Iterator[Expression]:
    """Yield an input for each state and scalar that a layer keeps."""
    states = memory = 0
    for part in kept:
        if part.dtype == _STATE:
            yield make.named("state", states)
            states += 1
            continue
        for _ in range(int(np.prod(part.shape, dtype=int))):
            yield make.named("memory", memory)
            memory += 1


def _sorted(
    expressions: list[Expression], kept: list[Any]
) -> tuple[tuple[Expression, ...], tuple[Expression, ...]]:
    """Return the states of the law beneath, and the layer's own memory."""
    is_state = [part.dtype == _STATE for part in kept for _ in range(int(np.prod(part.shape)))]
    pairs = list(zip(expressions, is_state, strict=True))
    return tuple(x for x, own in pairs if own), tuple(x for x, own in pairs if not own)


def _identifier(name: str) -> str:
    return re.sub(r"\W+", "_", name).strip("_")


def _instruction(name: str, results: Callable[..., list[ShapedArray]]) -> core.Primitive:
    made = core.Primitive(name)
    made.multiple_results = True
    made.def_abstract_eval(results)
    return made


_NUMBER = ShapedArray((), np.dtype(float))
_A_STATE = ShapedArray((), np.dtype(_STATE))
_BEGIN = _instruction("begin_beneath", lambda *_: [_A_STATE])
_STEP = _instruction("step_beneath", lambda *_: [_A_STATE, _NUMBER])
_FORCE = _instruction("elastic_force", lambda *_: [_NUMBER])
_STIFFNESS = _instruction("stiffness", lambda *_: [_NUMBER])


_CALLS = {
    "begin_beneath": lambda make, depth: [make.call("begin_beneath", depth)],
    "step_beneath": lambda make, state, *line: [
        moved := make.call("step_beneath", state, *line),
        make.call("force_beneath", moved),
    ],
    "elastic_force": lambda make, depth: [make.call("elastic_force", depth)],
    "stiffness": lambda make, depth: [make.call("stiffness", depth)],
}


class _Elastic:
    """The elastic law beneath a layer, at one depth."""

    def force(self, depth: Any) -> Any:
        return _FORCE.bind(_number(depth))[0]

    def stiffness(self, depth: Any) -> Any:
        return _STIFFNESS.bind(_number(depth))[0]

    def __getattr__(self, name: str) -> Any:
        raise TranslationError(f"its step asks for the elastic law's {name}")


class _Beneath:
    """The law beneath a layer, of which only calls are noted."""

    elastic = _Elastic()

    def begin(self, displacement: Any) -> Any:
        return _BEGIN.bind(_number(displacement))[0]

    def step(self, state: Any, line: Line) -> Any:
        parts = line.duration, line.displacement, line.velocity, line.clear
        return tuple(_STEP.bind(state, *map(_number, parts)))

    def __getattr__(self, name: str) -> Any:
        raise TranslationError(f"its step asks for the {name} of the law beneath it")


def _number(value: Any) -> Any:
    return jnp.asarray(value, dtype=float)
