"""The elastic law and the layers as functions of another language."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from qlvbayes.use.exports.expressions import Expression
from qlvbayes.use.exports.language import Language
from qlvbayes.use.exports.layers import ElasticFunction, ExportedLayer, LayerComputation

_SIGNS = {
    "add": "+",
    "sub": "-",
    "mul": "*",
    "div": "/",
    "lt": "<",
    "le": "<=",
    "gt": ">",
    "ge": ">=",
    "eq": "==",
    "and": "&&",
    "or": "||",
}
LIBRARY = {
    "exp": "exp",
    "expm1": "expm1",
    "log": "log",
    "log1p": "log1p",
    "sqrt": "sqrt",
    "tanh": "tanh",
    "sin": "sin",
    "cos": "cos",
    "abs": "fabs",
    "max": "fmax",
    "min": "fmin",
    "pow": "pow",
}
"""Functions of C's library, by what they do."""
_INPUTS = ("constant", "constant_of", "memory", "line", "state", "force_beneath")
_STATES = ("state", "begin_beneath", "step_beneath")


def library_of(elastic: Iterable[ElasticFunction], pieces: Iterable[ExportedLayer]) -> set[str]:
    """Return the functions of C's library that the elastic law and the layers call."""
    works = [one.work for one in elastic]
    works += [work for piece in pieces for work in (piece.begin, piece.step)]
    return {LIBRARY[x.op] for work in works for x in work.ordered if x.op in LIBRARY}


class Statements:
    """The statements of a function, in which what is used more than once gets a name."""

    def __init__(self, language: Language, work: LayerComputation) -> None:
        self.language, self.work = language, work
        self.text: list[str] = []
        self._named: dict[int, str] = {}
        for x in work.ordered:
            self._note(x)

    def _note(self, x: Expression) -> None:
        if x.op not in _INPUTS and self.work.used[id(x)] > 1:
            name, written = f"t{len(self._named) + 1}", self.write(x)
            self._named[id(x)] = name
            self.text.append(self.language.set(name, written, truth=x.is_true_or_false))

    def write(self, x: Expression) -> str:
        """Return the expression in one line of text, or the name that it has."""
        language = self.language
        if (name := self._named.get(id(x))) is not None:
            return name
        if x.op == "constant":
            if isinstance(x.value, bool):
                return language.truth(x.value)
            return language.say("number", float(x.value))
        if x.op == "constant_of":
            return language.say("constant", x.value)
        if x.op == "memory":
            return language.say("memory", x.value)
        if x.op == "line":
            return x.value
        args = [self.write(y) for y in x.args]
        if x.op in _SIGNS:
            return f"({args[0]} {_SIGNS[x.op]} {args[1]})"
        if x.op == "neg":
            return f"(-{args[0]})"
        if x.op == "not":
            return language.say("opposite", args[0])
        if x.op == "ne":
            return language.say("opposite", f"({args[0]} == {args[1]})")
        if x.op == "choose":
            return language.say("either", *args)
        if x.op in LIBRARY:
            return f"{language.library(LIBRARY[x.op])}({', '.join(args)})"
        return f"{language.say('own', x.op)}({', '.join(['k', *args])})"  # of the elastic law


class LayerStatements(Statements):
    """The statements of a layer's ``begin`` or ``step``; the language writes them one by one."""

    def __init__(
        self, language: Language, piece: ExportedLayer, below: str, work: LayerComputation
    ) -> None:
        self.piece, self.below = piece, below
        self._locations: dict[int, str] = {}
        self._slot = _slots(work)
        super().__init__(language, work)
        self._end()

    def _note(self, x: Expression) -> None:
        if x.op in _STATES:
            self._state(x)
        else:
            super()._note(x)

    def write(self, x: Expression) -> str:
        """Return the expression in one line of text, or the name that it has."""
        return self._named[id(x.args[0])] if x.op == "force_beneath" else super().write(x)

    def _state(self, x: Expression) -> None:
        """Write the statements that make a state of the law beneath."""
        own = self.language.beneath
        if x.op == "state":
            self._locations[id(x)] = own(int(x.value), self.piece.beneath)
            return
        if x.op == "begin_beneath":
            location = self._kept(x)
            depth = self.write(x.args[0])
            self.text.append(self.language.say("begin", self.below, location, depth))
        else:
            before, *line = x.args
            location = self._locations[id(before)]
            if self.work.used[id(before)] > 1:  # goes on from there more than once
                copy = f"c{len(self._locations) + 1}"
                self.text.append(self.language.say("copy", self.below, copy, location))
                location = copy
            wanted = any(y.op == "force_beneath" and y.args[0] is x for y in self.work.ordered)
            name = f"f{len(self._locations) + 1}" if wanted else None
            self._named[id(x)] = name or ""
            followed = "followed" if self.work.force else self.language.truth(False)  # of a begin
            words = [*(self.write(y) for y in line), followed]
            self.text.append(self.language.step(self.below, name, location, words))
        self._locations[id(x)] = location

    def _kept(self, x: Expression) -> str:
        """Return where a state that begins is kept."""
        if (slot := self._slot.get(id(x))) is not None:
            return self.language.beneath(slot, self.piece.beneath)
        name = f"c{len(self._locations) + 1}"
        self.text.append(self.language.say("declared", self.below, name))
        return name

    def _end(self) -> None:
        language, work = self.language, self.work
        memory = []
        for i, x in enumerate(work.memory):
            if x.op != "memory" or x.value != i:
                memory.append((i, self.write(x)))
        if work.force is not None:
            self.text.append(language.set("force", self.write(work.force), truth=False))
        if len(memory) > 1:  # none is set before all are worked out
            self.text += [language.set(f"m{i}", text, truth=False) for i, text in memory]
            memory = [(i, f"m{i}") for i, _ in memory]
        self.text += [language.say("remember", i, text) for i, text in memory]
        for i, x in enumerate(work.states):
            own = language.beneath(i, self.piece.beneath)
            if self._locations[id(x)] != own:
                self.text.append(f"{own} = {self._locations[id(x)]};")


def _slots(work: LayerComputation) -> dict[int, int]:
    """Return the index of the layer's own state that each state, by its id, becomes."""
    slots: dict[int, int] = {}
    for slot, x in enumerate(work.states):
        while x.op in _STATES and x.op != "state":
            slots[id(x)] = slot
            if x.op == "begin_beneath":
                break
            x = x.args[0]
    return slots


MATERIAL = "material"
"""What lies beneath the innermost layer."""


def elastic_code(functions: Iterable[ElasticFunction], language: Language) -> str:
    """Return the functions of the elastic law."""
    texts = []
    for one in functions:
        body = Statements(language, one.work)
        assert one.work.force is not None
        texts.append(language.function(one, body.text, body.write(one.work.force)))
    return "\n".join(texts)


def layers_code(pieces: Sequence[ExportedLayer], language: Language) -> str:
    """Return the functions of all layers, the innermost first."""
    texts, below = [], MATERIAL
    for piece in pieces:
        if piece.late:
            texts.append(language.late(piece, below))
        else:
            begin, step = (
                LayerStatements(language, piece, below, x).text for x in (piece.begin, piece.step)
            )
            texts.append(language.layer(piece, below, begin, step))
        below = piece.name
    return "\n".join(texts)
