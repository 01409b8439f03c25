"""The languages in which the elastic law and the layers are written out, each as its spellings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from qlvbayes.effects.lags import LINES
from qlvbayes.use.exports.card import in_comment, template
from qlvbayes.use.exports.layers import LINE, ElasticFunction, ExportedLayer

_C = {
    "library": "{P}_{upper}",
    "number": "{P}_R({0!r})",
    "true": "1",
    "false": "0",
    "constant": "k->{0}",
    "own": "{p}_{0}",
    "either": "({0} ? {1} : {2})",
    "opposite": "(!{0})",
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
    "library": "{0}",
    "number": "{0!r}",
    "true": "true",
    "false": "false",
    "constant": "k.{0}",
    "own": "{0}_",
    "either": "pick_({0}, {1}, {2})",  # both sides are evaluated, and one is taken
    "opposite": "(~{0})",
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
_IN_MATLAB = {"pow": "power", "fabs": "abs", "fmax": "max", "fmin": "min"}


class Language:
    """The syntax of a language: its spellings, and how its functions are put together."""

    spellings: Mapping[str, str]
    late_file: str  # template of the functions of a late channel

    def __init__(self, prefix: str = "") -> None:
        self.prefix = prefix

    def say(self, what: str, *parts: object) -> str:
        """Return one of the spellings with its parts filled in; indices count from 0."""
        first = parts[0] if parts else ""
        more = {"upper": str(first).upper(), "next": first + 1 if isinstance(first, int) else ""}
        return self.spellings[what].format(*parts, p=self.prefix, P=self.prefix.upper(), **more)

    def library(self, name: str) -> str:
        """Return a function of C's library in the language's own."""
        return self.say("library", name)

    def truth(self, value: bool) -> str:
        """Return the literal of true or of false."""
        return self.say("true" if value else "false")

    def within(self, way: str, member: str) -> str:
        """Return what a layer writes for a member of its own, of the state that lies at ``way``."""
        return f"{way}.{member.removeprefix(self.say('state'))}"

    def beneath(self, index: int, count: int) -> str:
        """Return a state of the layer beneath, of so many."""
        return self.say("below") if count == 1 else self.say("of_several", index)

    def set(self, name: str, text: str, *, truth: bool) -> str:
        """Return a statement that gives a number, or a condition, its name."""
        return self.say("set_truth" if truth else "set_number", name, text)

    def step(self, below: str, name: str | None, location: str, line: Sequence[str]) -> str:
        """Return a statement with which the layer beneath goes along a line."""
        what = "step" if name is None else "force_of_step"
        return self.say(what, below, location, ", ".join(line), name)

    def function(self, one: ElasticFunction, body: list[str], result: str) -> str:
        """Return a function of the elastic law, from its statements and the value's expression."""
        raise NotImplementedError

    def layer(self, piece: ExportedLayer, below: str, begin: list[str], step: list[str]) -> str:
        """Return both functions of a layer, from their statements."""
        raise NotImplementedError

    def late(self, piece: ExportedLayer, below: str) -> str:
        """Return both functions of a late channel, which keeps the lines that are on their way."""
        names = {"p": self.prefix, "P": self.prefix.upper(), "delay": piece.constants[0]}
        return template(self.late_file, piece=piece, below=below, most=LINES, **names)


class C(Language):
    """C99 in the pad's own type of number: a variant for float has no double in it."""

    spellings = _C
    late_file = "late.h.j2"

    def function(self, one: ElasticFunction, body: list[str], result: str) -> str:
        """Return a function of the elastic law."""
        real, arguments = f"{self.prefix}_real", ("k", *one.arguments)
        typed = [f"const {self.prefix}_constants *k", *(f"{real} {x}" for x in one.arguments)]
        head = f"static inline {real} {self.say('own', one.name)}({', '.join(typed)})"
        return f"/* {one.summary} */\n" + _body(head, arguments, [*body, f"return {result};"])

    def layer(self, piece: ExportedLayer, below: str, begin: list[str], step: list[str]) -> str:
        """Return both functions of a layer."""
        p, name = self.prefix, piece.name
        state, count = f"{p}_{name}_state", "" if piece.beneath == 1 else f"[{piece.beneath}]"
        memory = [f"    {p}_real m[{piece.memory}];"] if piece.memory else []
        members = [f"    {p}_{below}_state below{count};", *memory]
        given = f"const {p}_constants *k, {state} *s"
        begins = f"static inline void {p}_begin_{name}({given}, {p}_real displacement)"
        steps = (
            f"static inline {p}_real {p}_step_{name}({given}, {p}_real h, {p}_real to,\n"
            f"    {p}_real speed, {p}_real clear, int followed)"
        )
        formula = in_comment([" ".join(piece.formula.split())])[0]
        return "\n".join([
            f"/* {name}: {formula} */", "typedef struct {", *members, f"}} {state};", "",
            _body(begins, ("k", "displacement"), begin),
            _body(steps, ("k", *LINE, "followed"), [*step, "return force;"]),
        ])  # fmt: skip


def _body(head: str, arguments: Sequence[str], body: Sequence[str]) -> str:
    """Return a function of C, which says of the arguments that it does not use that they are."""
    written = "".join(x if x.isalnum() or x == "_" else " " for x in " ".join(body)).split()
    unused = [f"(void){x};" for x in arguments if x not in written]
    return "\n".join([head, "{", *(f"    {line}" for line in (*unused, *body)), "}", ""])


class Matlab(Language):
    """MATLAB's language, which GNU Octave runs."""

    spellings = _MATLAB
    late_file = "late.m.j2"

    def library(self, name: str) -> str:
        """Return a function of C's library under MATLAB's name."""
        return _IN_MATLAB.get(name, name)

    def function(self, one: ElasticFunction, body: list[str], result: str) -> str:
        """Return a function of the elastic law."""
        head = f"result_ = {self.say('own', one.name)}({', '.join(['k', *one.arguments])})"
        return _matlab(head, [f"% {one.summary}", *body, f"result_ = {result};"])

    def layer(self, piece: ExportedLayer, below: str, begin: list[str], step: list[str]) -> str:
        """Return both functions of a layer."""
        summary = f"% {piece.name}: {' '.join(piece.formula.split())}"
        given = f"k, state, {', '.join(LINE)}, followed"
        return "\n".join([
            _matlab(f"state = begin_{piece.name}_(k, displacement)",
                    [summary, *(begin or ["state = struct();"])]),
            _matlab(f"[force, state] = step_{piece.name}_({given})", step),
        ])  # fmt: skip


def _matlab(head: str, body: Sequence[str]) -> str:
    return "\n".join([f"function {head}", *(f"  {line}" for line in body), "end", ""])
