"""The functions of ``formulas`` in C and in MATLAB."""

from __future__ import annotations

import ast
import inspect
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import ClassVar

from qlvbayes.use.exports import formulas
from qlvbayes.use.exports.formulas import Formulas, Function
from qlvbayes.use.exports.layers import ExportedLayer

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
    """The syntax of a language, for functions of scalars."""

    @abstractmethod
    def library(self, name: str) -> str:
        """Return a function of C's library in the language's own."""

    @abstractmethod
    def number(self, value: float) -> str:
        """Return a literal."""

    @abstractmethod
    def constant(self, name: str) -> str:
        """Return a law's constant."""

    @abstractmethod
    def own(self, name: str) -> str:
        """Return the name of a function that is generated."""

    @abstractmethod
    def either(self, condition: str, yes: str, no: str) -> str:
        """Return ``yes`` where the condition holds, else ``no``."""

    @abstractmethod
    def function(
        self,
        name: str,
        summary: str,
        arguments: list[str],
        body: list[tuple[str, str]],
        result: str,
    ) -> str:
        """Return a whole function: ``body`` has names and what they are set to."""

    @abstractmethod
    def truth(self, value: bool) -> str:
        """Return the literal of true or of false."""

    @abstractmethod
    def opposite(self, condition: str) -> str:
        """Return where a condition does not hold."""

    top: ClassVar[str]
    """The outermost layer's state, within the pad's."""

    @abstractmethod
    def within(self, way: str, member: str) -> str:
        """Return what a layer writes for a member of its own, of the state that lies at ``way``."""

    @abstractmethod
    def memory(self, index: int) -> str:
        """Return a number that the layer remembers."""

    @abstractmethod
    def beneath(self, index: int, count: int) -> str:
        """Return a state of the layer beneath, of so many."""

    @abstractmethod
    def set(self, name: str, text: str, *, truth: bool) -> str:
        """Return a statement that gives a number, or a condition, its name."""

    @abstractmethod
    def remember(self, index: int, text: str) -> str:
        """Return a statement that sets what the layer remembers."""

    @abstractmethod
    def declared(self, below: str, name: str) -> str:
        """Return a statement that makes room for a state of the layer beneath."""

    @abstractmethod
    def copy(self, below: str, name: str, location: str) -> str:
        """Return a statement that copies a state of the layer beneath."""

    @abstractmethod
    def keep(self, location: str, name: str) -> str:
        """Return a statement that puts a state where the layer keeps it."""

    @abstractmethod
    def begin(self, below: str, location: str, displacement: str) -> str:
        """Return a statement with which the layer beneath begins."""

    @abstractmethod
    def step(self, below: str, name: str | None, location: str, line: list[str]) -> str:
        """Return a statement with which the layer beneath goes along a line.

        Its force gets the name.
        """

    @abstractmethod
    def layer(self, piece: ExportedLayer, below: str, begin: list[str], step: list[str]) -> str:
        """Return both functions of a layer, from their statements."""

    @abstractmethod
    def late(self, piece: ExportedLayer, below: str) -> str:
        """Return both functions of a late channel, which keeps the lines that are on their way."""


def functions_of(law: Formulas, language: Language) -> str:
    """Return functions elastic_force, stiffness, step and slope of the law, and all they call."""
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


def needs(law: Formulas) -> set[str]:
    """Return the functions of C's library that a step calls."""
    order: dict[str, Function] = {}
    for function in (law.force, law.stiffness, law.step, law.slope):
        _gather(function, order)
    calls = {name for function in order.values() for name in _calls(function)}
    return calls & set(_LIBRARY) | {"exp"}  # of every decay


def _gather(function: Function, order: dict[str, Function]) -> None:
    """Append the function after those that it calls."""
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
    summary = (inspect.getdoc(function) or "").partition("\n")[0].replace("`", "")
    arguments = [argument.arg for argument in node.args.args]
    name = short.get(node.name, node.name)
    return language.function(language.own(name), summary, arguments, body, write(last.value))


class _Writer:
    """Expressions in a language; what ``formulas`` may not hold is a TypeError."""

    def __init__(self, short: dict[str, str], language: Language) -> None:
        self.short, self.language = short, language

    def __call__(self, node: ast.expr) -> str:
        translate: Callable[[ast.expr], str] | None = getattr(self, f"_{type(node).__name__}", None)
        if translate is None:
            raise TypeError(f"no translation of {ast.unparse(node)}")
        return translate(node)

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
