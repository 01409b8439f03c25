"""The elastic law and the layers in C and in MATLAB: expressions as the statements of functions."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from qlvbayes.use.exports.expressions import Expression
from qlvbayes.use.exports.layers import ElasticFunction, ExportedLayer, LayerComputation

_C = {
    "number": "{P}_R({0!r})",
    "true": "1",
    "false": "0",
    "constant_of": "k->{0}",
    "own": "{p}_{0}",
    "choose": "({0} ? {1} : {2})",
    "not": "(!{0})",
    "top": "s->top",
    "state": "s->",
    "below": "s->below",
    "of_several": "s->below[{0}]",
    "memory": "s->m[{0}]",
    "set_number": "const {p}_real {0} = {1};",
    "set_truth": "const int {0} = {1};",
    "remember": "s->m[{0}] = {1};",
    "declared": "{p}_{0}_state {1};",
    "copy": "{p}_{0}_state {1} = {2};",
    "begin": "{p}_begin_{0}(k, &{1}, {2});",
    "step": "{p}_step_{0}(k, &{1}, {2});",
    "force_of_step": "const {p}_real {3} = {p}_step_{0}(k, &{1}, {2});",
}
_MATLAB = {
    "number": "{0!r}",
    "true": "true",
    "false": "false",
    "constant_of": "k.{0}",
    "own": "{0}_",
    "choose": "pick_({0}, {1}, {2})",  # both sides are evaluated, and one is taken
    "not": "(~{0})",
    "top": "state.top",
    "state": "state.",
    "below": "state.below",
    "of_several": "state.below{{{next}}}",
    "memory": "state.m({next})",
    "set_number": "{0} = {1};",
    "set_truth": "{0} = {1};",
    "remember": "state.m({next}) = {1};",
    "declared": "{1} = struct();",
    "copy": "{1} = {2};",
    "begin": "{1} = begin_{0}_(k, {2});",
    "step": "[~, {1}] = step_{0}_(k, {1}, {2});",
    "force_of_step": "[{3}, {1}] = step_{0}_(k, {1}, {2});",
}
_SIGNS = {"add": "+", "sub": "-", "mul": "*", "div": "/", "and": "&&", "or": "||"} | {
    "lt": "<", "le": "<=", "gt": ">", "ge": ">=", "eq": "=="
}  # fmt: skip
_FUNCTIONS = ("exp", "expm1", "log", "log1p", "sqrt", "tanh", "sin", "cos", "pow")
LIBRARY = {name: name for name in _FUNCTIONS} | {"abs": "fabs", "max": "fmax", "min": "fmin"}
"""Functions of C's library, by what they do."""
MATERIAL = "material"
"""What lies beneath the innermost layer."""
_INPUTS = ("constant", "constant_of", "memory", "line", "state", "force_beneath")
_STATES = ("state", "begin_beneath", "step_beneath")


@dataclass(frozen=True)
class Language:
    """The spellings of a language, and its names of the functions in C's library."""

    spellings: Mapping[str, str]
    library: Mapping[str, str]
    prefix: str = ""

    def say(self, what: str, *parts: object) -> str:
        """Return one of the spellings with its parts filled in; indices count from 0."""
        first = parts[0] if parts else ""
        following = first + 1 if isinstance(first, int) else ""
        p = self.prefix
        return self.spellings[what].format(*parts, p=p, P=p.upper(), next=following)

    def truth(self, value: bool) -> str:
        """Return the literal of true or of false."""
        return self.say("true" if value else "false")

    def beneath(self, index: int, count: int) -> str:
        """Return a state of the layer beneath, of so many."""
        return self.say("below") if count == 1 else self.say("of_several", index)

    def set(self, name: str, text: str, *, truth: bool = False) -> str:
        """Return a statement that gives a number, or a condition, its name."""
        return self.say("set_truth" if truth else "set_number", name, text)


def in_c(prefix: str) -> Language:
    """Return C99 in the pad's own type of number: a variant for float has no double in it."""
    return Language(_C, {x: f"{prefix.upper()}_{y.upper()}" for x, y in LIBRARY.items()}, prefix)


MATLAB = Language(_MATLAB, {name: name for name in LIBRARY} | {"pow": "power"})
"""MATLAB's language, which GNU Octave runs."""


def library_of(elastic: Iterable[ElasticFunction], pieces: Iterable[ExportedLayer]) -> set[str]:
    """Return the functions of C's library that the elastic law and the layers call."""
    works = [one.work for one in elastic]
    works += [work for piece in pieces for work in (piece.begin, piece.step)]
    return {LIBRARY[x.op] for work in works for x in work.ordered if x.op in LIBRARY}


@dataclass(frozen=True)
class WrittenFunction:
    """A function of the elastic law: its arguments, statements, and the expression of its value."""

    name: str
    summary: str
    arguments: tuple[str, ...]
    statements: list[str]
    result: str


@dataclass(frozen=True)
class WrittenLayer:
    """A layer, what lies beneath it, and the statements of its two functions."""

    piece: ExportedLayer
    below: str
    begin: list[str]
    step: list[str]


def elastic_code(functions: Iterable[ElasticFunction], language: Language) -> list[WrittenFunction]:
    """Return the functions of the elastic law."""
    written = []
    for one in functions:
        body = _Statements(language, one.work)
        assert one.work.force is not None
        result = body.write(one.work.force)
        given = language.say("own", one.name), one.summary, one.arguments
        written.append(WrittenFunction(*given, body.text, result))
    return written


def layers_code(pieces: Sequence[ExportedLayer], language: Language) -> Iterator[WrittenLayer]:
    """Yield every layer as code, the innermost first."""
    below = MATERIAL
    for piece in pieces:
        works = () if piece.late else (piece.begin, piece.step)
        begin, step = [_Layer(language, piece, below, x).text for x in works] or ([], [])
        yield WrittenLayer(piece, below, begin, step)
        below = piece.name


def touch_of(pieces: Sequence[ExportedLayer], language: Language) -> str | None:
    """Return where it is remembered whether the specimen is touched."""
    way, own = language.say("top"), language.say("state")
    for piece in reversed(pieces):
        if piece.touch is not None:
            return f"{way}.{language.say('memory', piece.touch).removeprefix(own)}"
        below = language.beneath(piece.beneath - 1, piece.beneath)
        way = f"{way}.{below.removeprefix(own)}"
    return None


class _Statements:
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
            truth = isinstance(x.value, bool)
            return language.truth(x.value) if truth else language.say("number", float(x.value))
        if x.op in ("constant_of", "memory"):
            return language.say(x.op, x.value)
        if x.op == "line":
            return x.value
        args = [self.write(y) for y in x.args]
        if x.op in _SIGNS:
            return f"({args[0]} {_SIGNS[x.op]} {args[1]})"
        if x.op == "neg":
            return f"(-{args[0]})"
        if x.op in ("not", "choose"):
            return language.say(x.op, *args)
        if x.op == "ne":
            return language.say("not", f"({args[0]} == {args[1]})")
        if x.op in LIBRARY:
            return f"{language.library[x.op]}({', '.join(args)})"
        return f"{language.say('own', x.op)}({', '.join(['k', *args])})"  # of the elastic law


class _Layer(_Statements):
    """The statements of a layer's ``begin`` or ``step``.

    A state of the law beneath lies somewhere, and each of its steps is a statement that changes it
    there.
    """

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
            self._locations[id(x)] = self._location(x)
        else:
            super()._note(x)

    def write(self, x: Expression) -> str:
        """Return the expression in one line of text, or the name that it has."""
        return self._named[id(x.args[0])] if x.op == "force_beneath" else super().write(x)

    def _location(self, x: Expression) -> str:
        """Write the statements that make a state of the law beneath; return where it then is."""
        language, count = self.language, len(self._locations) + 1
        if x.op == "state":
            return language.beneath(int(x.value), self.piece.beneath)
        if x.op == "begin_beneath":
            if (slot := self._slot.get(id(x))) is not None:
                location = language.beneath(slot, self.piece.beneath)
            else:
                location = f"c{count}"
                self.text.append(language.say("declared", self.below, location))
            self.text.append(language.say("begin", self.below, location, self.write(x.args[0])))
            return location
        before, *line = x.args
        location = self._locations[id(before)]
        if self.work.used[id(before)] > 1:  # goes on from there more than once
            copy = f"c{count}"
            self.text.append(language.say("copy", self.below, copy, location))
            location = copy
        wanted = any(y.op == "force_beneath" and y.args[0] is x for y in self.work.ordered)
        name = self._named[id(x)] = f"f{count}" if wanted else ""
        followed = "followed" if self.work.force else language.truth(False)  # of a begin
        words = ", ".join([*(self.write(y) for y in line), followed])
        kind = "force_of_step" if wanted else "step"
        self.text.append(language.say(kind, self.below, location, words, name))
        return location

    def _end(self) -> None:
        language, work = self.language, self.work
        changed = [(i, x) for i, x in enumerate(work.memory) if (x.op, x.value) != ("memory", i)]
        memory = [(i, self.write(x)) for i, x in changed]
        if work.force is not None:
            self.text.append(language.set("force", self.write(work.force)))
        if len(memory) > 1:  # none is set before all are worked out
            self.text += [language.set(f"m{i}", text) for i, text in memory]
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
