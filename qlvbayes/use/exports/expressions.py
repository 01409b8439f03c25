"""A program of JAX on a few scalars as expressions that can be written in another language.

`Expressions.from_program` runs a program's instructions (its jaxpr) on expressions, not on numbers:
arrays become their elements, functions within are gone through, choices stay choices. Equal
expressions are one object, so that what is used twice is computed once.
"""

from __future__ import annotations

import contextlib
import math
import operator
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import jax
import numpy as np
from jax.extend import core

Nodes = np.ndarray
"""An array of `Expression`, of the shape that the program's array has."""


class TranslationError(Exception):
    """Exception for a program that does what no expression does; the text says what."""


class Expression:
    """Operation ``op`` on ``args``; ``value`` is the number of a constant or name of an input."""

    __slots__ = ("args", "op", "value")

    def __init__(self, op: str, args: tuple[Expression, ...], value: Any) -> None:
        self.op, self.args, self.value = op, args, value

    @property
    def is_true_or_false(self) -> bool:
        """True of a condition, false of a number."""
        return self.op in _CONDITIONS or (self.op == "constant" and isinstance(self.value, bool))


_PAIRS: dict[str, Callable[..., Any]] = {
    "add": operator.add,
    "sub": operator.sub,
    "mul": operator.mul,
    "div": operator.truediv,
    "max": max,
    "min": min,
    "pow": pow,
    "lt": operator.lt,
    "le": operator.le,
    "gt": operator.gt,
    "ge": operator.ge,
    "eq": operator.eq,
    "ne": operator.ne,
    "and": operator.and_,
    "or": operator.or_,
}
_SINGLES: dict[str, Callable[..., Any]] = {
    "neg": operator.neg,
    "exp": math.exp,
    "expm1": math.expm1,
    "log": math.log,
    "log1p": math.log1p,
    "sqrt": math.sqrt,
    "tanh": math.tanh,
    "sin": math.sin,
    "cos": math.cos,
    "abs": abs,
    "not": operator.not_,
}
_CONDITIONS = ("lt", "le", "gt", "ge", "eq", "ne", "and", "or", "not")
_MOVES = (
    "broadcast_in_dim",
    "concatenate",
    "expand_dims",
    "reshape",
    "rev",
    "slice",
    "split",
    "squeeze",
    "stack",
    "tile",
    "transpose",
    "unstack",
)
_INSIDE = ("jaxpr", "call_jaxpr", "fun_jaxpr")  # where an instruction has a program of its own
_LOOPS = ("scan", "while")
_REDUCTIONS = {"reduce_sum": "add", "reduce_max": "max", "reduce_min": "min"}


class Expressions:
    """Factory of expressions.

    calls: what an instruction that only the caller knows becomes, given this and its arguments.
    """

    def __init__(self, calls: Mapping[str, Callable[..., list[Expression]]]) -> None:
        self._known: dict[tuple, Expression] = {}
        self._calls = calls

    def constant(self, value: float | bool) -> Expression:
        """Return a number, or true or false."""
        return self._node("constant", (), value)

    def named(self, name: str, value: Any) -> Expression:
        """Return an input; ``name`` is its kind, ``value`` which of them."""
        return self._node(name, (), value)

    def call(self, op: str, *args: Expression, value: Any = None) -> Expression:
        """Return ``op`` of the arguments, evaluated where they are constants."""
        if all(x.op == "constant" for x in args) and (known := _PAIRS | _SINGLES).get(op):
            with contextlib.suppress(ArithmeticError, ValueError):  # what is none stays as it is
                return self.constant(known[op](*(x.value for x in args)))
        return self._simpler(op, args) or self._node(op, args, value)

    def equate(self, one: Expression, same: Expression) -> None:
        """Let every later expression that equals ``one`` be ``same``."""
        self._known = {key: same if x is one else x for key, x in self._known.items()}

    def from_program(
        self, program: core.ClosedJaxpr, inputs: Sequence[Expression]
    ) -> list[Expression]:
        """Return all elements of the program's results, in order, from scalar inputs."""
        rest = iter(inputs)
        shapes = [variable.aval.shape for variable in program.jaxpr.invars]
        arrays = [_array([next(rest) for _ in range(math.prod(x))], x) for x in shapes]
        return [x for array in self._run(program, arrays) for x in array.ravel()]

    def _run(self, program: Any, inputs: Sequence[Nodes]) -> list[Nodes]:
        jaxpr, consts = (
            (program.jaxpr, program.consts) if hasattr(program, "jaxpr") else (program, ())
        )
        values: dict[Any, Nodes] = dict(zip(jaxpr.invars, inputs, strict=True))
        values |= {x: self._constants(y) for x, y in zip(jaxpr.constvars, consts, strict=True)}

        def read(atom: Any) -> Nodes:
            return self._constants(atom.val) if isinstance(atom, core.Literal) else values[atom]

        for line in jaxpr.eqns:
            results = self._instruction(line, [read(x) for x in line.invars])
            values |= dict(zip(line.outvars, results, strict=True))
        return [read(x) for x in jaxpr.outvars]

    def _instruction(self, line: Any, given: list[Nodes]) -> list[Nodes]:
        name, params = line.primitive.name, line.params
        name = "add" if name == "add_any" else name  # a sum of derivatives
        if name not in _LOOPS and (inside := [params[x] for x in _INSIDE if x in params]):
            return self._run(inside[0], given)
        if name in self._calls:
            return [_array([x], ()) for x in self._calls[name](self, *(x.item() for x in given))]
        if name in _PAIRS or name in _SINGLES or name in _ELEMENTWISE:
            return [self._elementwise(name, params, given)]
        if name in _MOVES:
            return _moved(line.primitive, params, given)
        if name in _REDUCTIONS:
            return [self._reduced(_REDUCTIONS[name], given[0], params["axes"])]
        if name == "dot_general":
            return [self._product(given[0], given[1], params["dimension_numbers"])]
        raise TranslationError(f"its step uses {name}, which has no form in other languages")

    def _elementwise(self, name: str, params: dict, given: list[Nodes]) -> Nodes:
        if name in ("integer_pow",):
            factors = [given[0]] * abs(params["y"])
            whole = np.broadcast_arrays(*factors)
            product = self._each(lambda *x: self._folded("mul", x), whole)
            one = _array([self.constant(1.0)], ())
            return product if params["y"] > 0 else self._each(self._pair("div"), [one, product])
        make = getattr(self, f"_{name}", None) or self._pair(name)
        return self._each(make, given)

    def _pair(self, op: str) -> Callable[..., Expression]:
        return lambda *x: self.call(op, *x)

    def _each(self, make: Callable[..., Expression], given: Sequence[Nodes]) -> Nodes:
        whole = np.broadcast_arrays(*given)
        results = [make(*row) for row in zip(*(x.ravel() for x in whole), strict=True)]
        return _array(results, whole[0].shape)

    def either(self, which: Expression, yes: Expression, no: Expression) -> Expression:
        """Return ``yes`` where a condition holds, else ``no``."""
        if which.op == "constant":
            return yes if which.value else no
        return yes if yes is no else self._node("choose", (which, yes, no), None)

    def _select_n(self, which: Expression, no: Expression, yes: Expression) -> Expression:
        return self.either(which, yes, no)

    def _sign(self, x: Expression) -> Expression:
        zero, one = self.constant(0.0), self.constant(1.0)
        below = self.either(self.call("lt", x, zero), self.constant(-1.0), zero)
        return self.either(self.call("gt", x, zero), one, below)

    def _square(self, x: Expression) -> Expression:
        return self.call("mul", x, x)

    def _clamp(self, low: Expression, x: Expression, high: Expression) -> Expression:
        return self.call("min", self.call("max", x, low), high)

    def _convert_element_type(self, x: Expression) -> Expression:
        if x.is_true_or_false:
            return self.either(x, self.constant(1.0), self.constant(0.0))
        return x

    def _copy(self, x: Expression) -> Expression:
        return x

    _copy_p = _stop_gradient = _copy

    def _folded(self, op: str, values: Iterable[Expression]) -> Expression:
        first, *others = values
        for other in others:
            first = self.call(op, first, other)
        return first

    def _reduced(self, op: str, given: Nodes, axes: Sequence[int]) -> Nodes:
        kept = [k for k in range(given.ndim) if k not in axes]
        moved = np.transpose(given, [*axes, *kept])
        shape = moved.shape[len(axes) :]
        columns = moved.reshape(-1, *shape)
        return self._each(lambda *x: self._folded(op, x), list(columns))

    def _product(self, left: Nodes, right: Nodes, dimensions: Any) -> Nodes:
        (on_left, on_right), batch = dimensions
        if any(batch):
            raise TranslationError("its step multiplies stacks of matrices")
        rows = np.moveaxis(left, on_left, range(len(on_left)))
        columns = np.moveaxis(right, on_right, range(len(on_right)))
        inner = rows.shape[: len(on_left)]
        shape = rows.shape[len(on_left) :] + columns.shape[len(on_right) :]
        rows = rows.reshape(math.prod(inner), -1)
        columns = columns.reshape(math.prod(inner), -1)
        sums = [
            self._folded("add", [self.call("mul", x, y) for x, y in zip(a, b, strict=True)])
            for a in rows.T
            for b in columns.T
        ]
        return _array(sums, shape)

    def _constants(self, value: Any) -> Nodes:
        array = np.asarray(value)
        return _array([self.constant(x) for x in array.ravel().tolist()], array.shape)

    def _simpler(self, op: str, args: tuple[Expression, ...]) -> Expression | None:
        """Return a sum with 0, a product with 0 or 1, simplified; None for any other operation."""
        zero = [x.op == "constant" and x.value == 0.0 for x in args]
        one = [x.op == "constant" and x.value == 1.0 for x in args]
        if op == "add" and any(zero):
            return args[zero.index(False)]
        if op == "mul" and any(zero):
            return args[zero.index(True)]
        if op == "mul" and any(one):
            return args[one.index(False)]
        if (op == "sub" and zero[1]) or (op == "div" and one[1]):
            return args[0]
        if op == "sub" and zero[0]:
            return self.call("neg", args[1])
        return None

    def _node(self, op: str, args: tuple[Expression, ...], value: Any) -> Expression:
        key = op, type(value), repr(value), *map(id, args)
        return self._known.setdefault(key, Expression(op, args, value))


_ELEMENTWISE = (
    "integer_pow",
    "select_n",
    "sign",
    "square",
    "clamp",
    "convert_element_type",
    "copy",
    "copy_p",
    "stop_gradient",
)


def _array(values: list[Expression], shape: tuple[int, ...]) -> Nodes:
    nodes = np.empty(len(values), dtype=object)
    nodes[:] = values
    return nodes.reshape(shape)


def _moved(primitive: Any, params: dict, given: list[Nodes]) -> list[Nodes]:
    """Return the elements in their new order: the instruction is run on their indices."""
    every = [x for array in given for x in array.ravel()]
    ends = np.cumsum([array.size for array in given])
    indices = [
        np.arange(end - array.size, end).reshape(array.shape)
        for array, end in zip(given, ends, strict=True)
    ]
    moved = primitive.bind(*map(jax.numpy.asarray, indices), **params)
    results = map(np.asarray, moved if primitive.multiple_results else [moved])
    return [_array([every[k] for k in x.ravel()], x.shape) for x in results]
