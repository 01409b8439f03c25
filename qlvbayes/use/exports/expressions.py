"""A program of JAX on a few scalars as expressions that can be written in another language.

`Expressions.from_program` runs a program's instructions (its jaxpr) on expressions, not on numbers:
arrays become their elements, functions within are gone through, choices stay choices. Equal
expressions are one object, so that what is used twice is computed once.
"""

from __future__ import annotations

import contextlib
import math
import operator
from collections.abc import Callable, Mapping, Sequence
from functools import partial, reduce
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


_CONDITIONS = ("lt", "le", "gt", "ge", "eq", "ne", "and", "or", "not")
_VALUES: dict[str, Callable[..., Any]] = {
    **{name: getattr(operator, name) for name in ("add", "sub", "mul", "neg", *_CONDITIONS[:6])},
    **{name: getattr(math, name) for name in ("exp", "expm1", "log", "log1p", "sqrt")},
    **{name: getattr(math, name) for name in ("tanh", "sin", "cos")},
    **{"div": operator.truediv, "max": max, "min": min, "pow": pow, "abs": abs},
    **{"and": operator.and_, "or": operator.or_, "not": operator.not_},
}
"""Every operation, as the function that evaluates it on constants."""
_SAME = ("copy", "copy_p", "stop_gradient")
_MOVES = (
    *("broadcast_in_dim", "concatenate", "expand_dims", "reshape", "rev", "slice", "split"),
    *("squeeze", "stack", "tile", "transpose", "unstack"),
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
        # instructions that are several operations, or a choice
        self._composed: dict[str, Callable[..., Expression]] = {
            "select_n": lambda which, no, yes: self.either(which, yes, no),
            "sign": self._sign,
            "square": lambda x: self.call("mul", x, x),
            "clamp": lambda low, x, high: self.call("min", self.call("max", x, low), high),
            "convert_element_type": self._as_number,
            **dict.fromkeys(_SAME, lambda x: x),
            "add_any": partial(self.call, "add"),  # a sum of derivatives
        }

    def constant(self, value: float | bool) -> Expression:
        """Return a number, or true or false."""
        return self._node("constant", (), value)

    def named(self, name: str, value: Any) -> Expression:
        """Return an input; ``name`` is its kind, ``value`` which of them."""
        return self._node(name, (), value)

    def call(self, op: str, *args: Expression) -> Expression:
        """Return ``op`` of the arguments, evaluated where they are constants."""
        if op in _VALUES and all(x.op == "constant" for x in args):
            with contextlib.suppress(ArithmeticError, ValueError):  # what is none stays as it is
                return self.constant(_VALUES[op](*(x.value for x in args)))
        return self._simpler(op, args) or self._node(op, args, None)

    def either(self, which: Expression, yes: Expression, no: Expression) -> Expression:
        """Return ``yes`` where a condition holds, else ``no``."""
        if which.op == "constant":
            return yes if which.value else no
        return yes if yes is no else self._node("choose", (which, yes, no), None)

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
        if name not in _LOOPS and (inside := [params[x] for x in _INSIDE if x in params]):
            return self._run(inside[0], given)
        if name in self._calls:
            return [_array([x], ()) for x in self._calls[name](self, *(x.item() for x in given))]
        if name == "integer_pow":
            return [_each(partial(self._power, params["y"]), given)]
        if name in _VALUES or name in self._composed:
            return [_each(self._composed.get(name, partial(self.call, name)), given)]
        if name in _MOVES:
            return _moved(line.primitive, params, given)
        if name in _REDUCTIONS:
            axes = params["axes"]
            parts = np.moveaxis(given[0], axes, range(len(axes)))
            rows = parts.reshape(-1, *parts.shape[len(axes) :])
            return [_each(partial(self._folded, _REDUCTIONS[name]), list(rows))]
        if name == "dot_general":
            return [self._product(given[0], given[1], params["dimension_numbers"])]
        raise TranslationError(f"its step uses {name}, which has no form in other languages")

    def _folded(self, op: str, *values: Expression) -> Expression:
        return reduce(partial(self.call, op), values)

    def _power(self, exponent: int, x: Expression) -> Expression:
        product = self._folded("mul", *[x] * abs(exponent))
        return product if exponent > 0 else self.call("div", self.constant(1.0), product)

    def _sign(self, x: Expression) -> Expression:
        zero, one = self.constant(0.0), self.constant(1.0)
        below = self.either(self.call("lt", x, zero), self.constant(-1.0), zero)
        return self.either(self.call("gt", x, zero), one, below)

    def _as_number(self, x: Expression) -> Expression:
        if x.is_true_or_false:
            return self.either(x, self.constant(1.0), self.constant(0.0))
        return x

    def _product(self, left: Nodes, right: Nodes, dimensions: Any) -> Nodes:
        (on_left, on_right), batch = dimensions
        if any(batch):
            raise TranslationError("its step multiplies stacks of matrices")
        rows = np.moveaxis(left, on_left, range(len(on_left)))
        columns = np.moveaxis(right, on_right, range(len(on_right)))
        inner = math.prod(rows.shape[: len(on_left)])
        shape = rows.shape[len(on_left) :] + columns.shape[len(on_right) :]
        sums = [
            self._folded("add", *(self.call("mul", x, y) for x, y in zip(a, b, strict=True)))
            for a in rows.reshape(inner, -1).T
            for b in columns.reshape(inner, -1).T
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


def _array(values: list[Expression], shape: tuple[int, ...]) -> Nodes:
    nodes = np.empty(len(values), dtype=object)
    nodes[:] = values
    return nodes.reshape(shape)


def _each(make: Callable[..., Expression], given: Sequence[Nodes]) -> Nodes:
    """Return what is made of the elements of arrays that are broadcast together."""
    whole = np.broadcast_arrays(*given)
    results = [make(*row) for row in zip(*(x.ravel() for x in whole), strict=True)]
    return _array(results, whole[0].shape)


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
