"""The functions of ``formulas`` in C and in MATLAB."""

from __future__ import annotations

import ast
import inspect
from abc import ABC, abstractmethod
from collections.abc import Callable

from qlvbayes.use.exports import formulas
from qlvbayes.use.exports.formulas import Formulas, Function

_OPERATORS: dict[type, str] = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/"}
_COMPARISONS: dict[type, str] = {
    ast.Lt: "<",
    ast.LtE: "<=",
    ast.Gt: ">",
    ast.GtE: ">=",
    ast.Eq: "==",
}
_LIBRARY = ("exp", "expm1", "pow")


class Language(ABC):
    """How a language writes a function of numbers."""

    @abstractmethod
    def library(self, name: str) -> str:
        """``exp``, ``expm1`` or ``pow`` of the language's own library."""

    @abstractmethod
    def number(self, value: float) -> str:
        """A literal."""

    @abstractmethod
    def constant(self, name: str) -> str:
        """A law's constant."""

    @abstractmethod
    def own(self, name: str) -> str:
        """Name of a function of ours."""

    @abstractmethod
    def either(self, condition: str, yes: str, no: str) -> str:
        """``yes`` where the condition holds, else ``no``."""

    @abstractmethod
    def function(
        self, name: str, told: str, arguments: list[str], body: list[tuple[str, str]], result: str
    ) -> str:
        """A whole function: ``body`` has names and what they are set to."""


def functions_of(law: Formulas, language: Language) -> str:
    """The law's functions, called elastic_force, stiffness, step and slope, and all they call."""
    names = {
        "elastic_force": law.force,
        "stiffness": law.stiffness,
        "step": law.step,
        "slope": law.slope,
    }
    order: dict[str, Function] = {}
    for function in names.values():
        _gather(function, order)
    short = {function.__name__: name for name, function in names.items()}
    texts = [_translated(order[name], short, language) for name in order]
    return "\n".join(texts)


def needs(law: Formulas) -> tuple[str, ...]:
    """Functions of the language's library that a step calls."""
    order: dict[str, Function] = {}
    for function in (law.force, law.stiffness, law.step, law.slope):
        _gather(function, order)
    calls = {name for function in order.values() for name in _calls(function)}
    return tuple(name for name in _LIBRARY if name in calls or name == "exp")  # of every decay


def _gather(function: Function, order: dict[str, Function]) -> None:
    """The function behind those that it calls."""
    for name in _calls(function):
        if name not in _LIBRARY and name not in order:
            _gather(getattr(formulas, name), order)
    order.setdefault(function.__name__, function)


def _calls(function: Function) -> list[str]:
    nodes = ast.walk(_parsed(function))
    return [n.func.id for n in nodes if isinstance(n, ast.Call) and isinstance(n.func, ast.Name)]


def _parsed(function: Function) -> ast.FunctionDef:
    (node,) = ast.parse(inspect.getsource(function)).body
    assert isinstance(node, ast.FunctionDef)
    return node


def _translated(function: Function, short: dict[str, str], language: Language) -> str:
    node = _parsed(function)
    write = _Writer(short, language)
    body = [
        (target.id, write(line.value))
        for line in node.body
        if isinstance(line, ast.Assign)
        for target in line.targets
        if isinstance(target, ast.Name)
    ]
    last = node.body[-1]
    assert isinstance(last, ast.Return)
    assert last.value is not None
    told = (inspect.getdoc(function) or "").partition("\n")[0].replace("`", "")
    arguments = [argument.arg for argument in node.args.args]
    name = short.get(node.name, node.name)
    return language.function(language.own(name), told, arguments, body, write(last.value))


class _Writer:
    """Expressions in a language; what ``formulas`` may not hold is a TypeError."""

    def __init__(self, short: dict[str, str], language: Language) -> None:
        self.short, self.language = short, language

    def __call__(self, node: ast.expr) -> str:
        found: Callable[[ast.expr], str] | None = getattr(self, f"_{type(node).__name__}", None)
        if found is None:
            raise TypeError(f"no translation of {ast.unparse(node)}")
        return found(node)

    def _Constant(self, node: ast.Constant) -> str:  # noqa: N802
        return self.language.number(float(node.value))  # type: ignore[arg-type]

    def _Name(self, node: ast.Name) -> str:  # noqa: N802
        return node.id

    def _Attribute(self, node: ast.Attribute) -> str:  # noqa: N802
        return self.language.constant(node.attr)

    def _BinOp(self, node: ast.BinOp) -> str:  # noqa: N802
        return f"({self(node.left)} {_OPERATORS[type(node.op)]} {self(node.right)})"

    def _UnaryOp(self, node: ast.UnaryOp) -> str:  # noqa: N802
        return f"(-{self(node.operand)})"

    def _Compare(self, node: ast.Compare) -> str:  # noqa: N802
        (sign,), (right,) = node.ops, node.comparators
        return f"{self(node.left)} {_COMPARISONS[type(sign)]} {self(right)}"

    def _IfExp(self, node: ast.IfExp) -> str:  # noqa: N802
        return self.language.either(self(node.test), self(node.body), self(node.orelse))

    def _Call(self, node: ast.Call) -> str:  # noqa: N802
        assert isinstance(node.func, ast.Name)
        name = node.func.id
        known = (
            self.language.library(name)
            if name in _LIBRARY
            else self.language.own(self.short.get(name, name))
        )
        return f"{known}({', '.join(self(x) for x in node.args)})"
