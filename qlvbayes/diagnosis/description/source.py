"""Write a described law as a Python file of one effect, and load the effect from it.

What is fitted is the class of the file itself, so that what a user adds is what was judged.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from hashlib import sha256
from types import ModuleType

from qlvbayes.diagnosis.description.grammar import Term
from qlvbayes.effects.effect import AbstractEffect
from qlvbayes.io.units import UnitSystem
from qlvbayes.laws.scales import Scales

_WIDE = 0.3
"""Share of a term's response for which its prior is made: a sixth of the peak force, three times as
much as a listed effect's, since something that large was seen to be left."""
_RANK = 90  # within a level: outside every listed effect of that level
_LEVELS = {"force": "ADDING", "factor": "SCALING", "shift": "DEPTH", "guide": "GUIDE"}
_KINDS = {"force": "force", "guide": "force", "factor": "fraction", "shift": "fraction"}
_IMPORTS = (
    ("dataclasses", "replace"),
    ("qlvbayes.effects.effect", "AbstractEffect"),
    ("qlvbayes.effects.effect", "Level"),
    ("qlvbayes.effects.history", "fading"),
    ("qlvbayes.effects.history", "largest"),
    ("qlvbayes.effects.history", "resolved_times"),
    ("qlvbayes.laws.hereditary", "Relaxing"),
    ("qlvbayes.laws.hereditary", "hereditary_force"),
    ("qlvbayes.laws.hereditary", "hereditary_step"),
    ("qlvbayes.laws.layered", "Law"),
    ("qlvbayes.laws.layered", "State"),
    ("qlvbayes.laws.layered", "at_depth"),
    ("qlvbayes.laws.layered", "line_at_depth"),
    ("qlvbayes.laws.motion", "Line"),
    ("qlvbayes.laws.motion", "Motion"),
    ("qlvbayes.laws.scales", "Scales"),
    ("qlvbayes.priors", "HalfNormal"),
    ("qlvbayes.priors", "LogUniform"),
    ("qlvbayes.priors", "Uniform"),
    ("qlvbayes.priors.distributions", "Constant"),
    ("qlvbayes.xp", "Array"),
)
"""What a file may import: module and name."""

_POWER = '''

def _power(velocity: Array, exponent: Array) -> Array:
    """Return |v|^n sgn v, which is 0 at rest with its slopes."""
    moving = velocity != 0.0
    size = xp.where(moving, xp.abs(velocity), 1.0) ** exponent
    return xp.where(moving, xp.sign(velocity) * size, 0.0)
'''


@dataclass(frozen=True)
class References:
    """Reference depth, speed, acceleration, force and time of a description, in the file's units.

    They are those of the pad's tests, to two digits.
    """

    depth: float
    speed: float
    acceleration: float
    force: float
    clock: float

    @classmethod
    def from_scales(cls, scales: Scales) -> References:
        """Return the scales of a pad's tests, each to two digits; 1 where a scale is 0."""
        some = (scales.depth, scales.speed, scales.acceleration, scales.force, scales.clock)
        return cls(*(float(f"{x:.2g}") if x > 0.0 else 1.0 for x in some))


def name_of(terms: Sequence[Term]) -> str:
    """Return the name of the law, as on the command line."""
    return "_and_".join(term.name for term in terms)


def formula_of(terms: Sequence[Term], references: References, units: UnitSystem) -> str:
    """Return the formula with the references in it, as ``F += k d^2 sgn v (with d = ...)``."""
    own = [_numbered(term.formula, k if len(terms) > 1 else 0) for k, term in enumerate(terms, 1)]
    length = "" if units.dimensionless else f" {units.displacement}"
    word, depth = "strain" if length == "" else "depth", f"{references.depth:g}{length}"
    where = {
        "d": f"{word}/({depth})",
        "v": f"velocity/({references.speed:g} {units.of('speed')})",
        "acceleration": f"itself/({references.acceleration:g}{length}/s2)",
        "elastic force": f"itself/({references.force:g} {units.force})",
        "T": f"{references.clock:g} s",
        "D": depth,
    }
    text = "; ".join(own)
    used = [
        f"{symbol} = {value}"
        for symbol, value in where.items()
        if re.search(rf"(?<![a-zA-Z]){symbol}(?![a-zA-Z])", text.replace("dd/", "d/"))
    ]
    return text + (f" (with {', '.join(used)})" if used else "")


def _numbered(formula: str, number: int) -> str:
    """Return a formula with the number of its term on the constants."""
    if not number:
        return formula
    return re.sub(r"(?<![a-zA-Z_])(k|n|a|q|dq|tau)(?![a-zA-Z_ce])", rf"\g<1>{number}", formula)


ADDED_BY = "COMMAND"
"""What stands in a law's file for the command that adds it, which the whole diagnosis knows."""


def source_of(terms: Sequence[Term], references: References, units: UnitSystem, about: str) -> str:
    """Return the text of a file that holds the law as one effect; ``about`` ends its docstring."""
    writer = _Writer(tuple(terms), references, units)
    body = writer.body()
    power = _POWER if "_power(" in body else ""
    modules: dict[str, list[str]] = {}
    for module, name in _IMPORTS:
        if re.search(rf"\b{name}\b", body + power):
            modules.setdefault(module, []).append(name)
    imports = [f"from {module} import {', '.join(own)}" for module, own in modules.items()]
    standard = [one for one in imports if one.startswith("from dataclasses")]
    arrays = ["import numpy as np", ""] if "np." in body else []
    return "\n".join([
        f'"""{formula_of(terms, references, units)}',
        "",
        about,
        '"""',
        "",
        "from __future__ import annotations",
        "",
        *standard,
        "from typing import ClassVar, Self",
        "",
        *arrays,
        "from qlvbayes import xp",
        *(one for one in imports if one not in standard),
        "",
        *writer.constants(body),
        power,
        "",
        body,
    ])  # fmt: skip


def load(text: str) -> type[AbstractEffect]:
    """Return the effect of a text of `source_of`.

    Its module counts as one of the package: the equations are the package's own, which run on
    arrays of NumPy for many sets of constants at once.
    """
    name = f"qlvbayes.diagnosis.description.described_{sha256(text.encode()).hexdigest()[:16]}"
    if name not in sys.modules:
        module = ModuleType(name)
        sys.modules[name] = module  # where dataclasses look up a class's own module
        exec(compile(text, name, "exec"), module.__dict__)  # the package's own text
    found = vars(sys.modules[name]).values()
    (kind,) = (
        one
        for one in found
        if isinstance(one, type) and issubclass(one, AbstractEffect) and one.__module__ == name
    )
    return kind


class _Writer:
    """Writes the class of one described law."""

    def __init__(self, terms: tuple[Term, ...], references: References, units: UnitSystem) -> None:
        self.terms, self.references, self.units = terms, references, units
        self.numbers = range(1, len(terms) + 1)
        self.remembering = [k for k, one in zip(self.numbers, terms, strict=True) if one.memory]
        self.clocked = any("clock" in re.findall(r"\w+", one.value) for one in terms)
        self.stepped = all(one.stepped for one in terms)

    def own(self, name: str, number: int) -> str:
        """Return the name of a constant of one term."""
        return name if len(self.terms) == 1 else f"{name}{number}"

    def constants(self, body: str) -> list[str]:
        """Return the lines that define the references."""
        depth = self.units.displacement
        known = {
            "DEPTH": (self.references.depth, depth),
            "SPEED": (self.references.speed, self.units.of("speed")),
            "ACCELERATION": (self.references.acceleration, f"{depth}/s2"),
            "FORCE": (self.references.force, self.units.force),
            "CLOCK": (self.references.clock, "s"),
        }
        return [
            f"{name} = {value!r}  # {unit}"
            for name, (value, unit) in known.items()
            if re.search(rf"\b{name}\b", body)
        ]

    def body(self) -> str:
        """Return the text of the class."""
        title = "".join(word.capitalize() for word in name_of(self.terms).split("_"))
        fields, units, null, docs = [], [], [], []
        for k, term in zip(self.numbers, self.terms, strict=True):
            kind = _KINDS[term.enters]
            amplitude = self.own("k", k)
            sign = "of either sign" if term.signed else "zero or more"
            shown = self.units.of(kind)
            docs.append(f"    * ``{amplitude}``: size ({shown}), {sign}.")
            null.append(f'"{amplitude}": 0.0')
            for name, own_kind, words in (
                (amplitude, kind, ""),
                *((self.own(one.name, k), one.unit, one.words) for one in term.shapes),
            ):
                fields.append(f"    {name}: Constant")
                units.append(f'"{name}": "{own_kind}"')
                if words:
                    docs.append(f"    * ``{name}``: {words} ({self.units.of(own_kind)}).")
        formula = formula_of(self.terms, self.references, self.units)
        off = any(term.enters == "guide" for term in self.terms)
        needs = next(
            (n for n in ("acceleration", "velocity") if any(t.needs == n for t in self.terms)), None
        )
        order = ("shift", "guide", "force", "factor")
        place = next(_LEVELS[one] for one in order if any(t.enters == one for t in self.terms))
        lines = [
            f"class {title}(AbstractEffect):",
            f'    """Described law: {formula}.',
            "",
            *docs,
            '    """',
            "",
            *fields,
            f'    name: ClassVar[str] = "{name_of(self.terms)}"',
            f"    level: ClassVar[Level] = Level.{place}",
            f"    rank: ClassVar[int] = {_RANK}",
            f"    units: ClassVar[dict[str, str]] = {{{', '.join(units)}}}",
            f"    null: ClassVar[dict[str, float]] = {{{', '.join(null)}}}",
            f'    law: ClassVar[str] = "{formula}"',
            '    seen: ClassVar[str] = "what the tests show beyond every listed effect"',
            '    reference: ClassVar[str] = "a description of one pad\'s tests; it names no cause"',
            *([f'    needs: ClassVar[str] = "{needs}"'] if needs else []),
            *(["    off_pad: ClassVar[bool] = True"] if off else []),
            *([] if self.stepped else [
                "    not_stepped: ClassVar[str] = "
                '"steps are of one test, and straight lines have no acceleration"',
            ]),
            "",
            *self._default(),
            "",
            *self._force(),
            *(["", *self._begin(), "", *self._step()] if self.stepped else []),
        ]  # fmt: skip
        return "\n".join(lines) + "\n"

    def _default(self) -> list[str]:
        """Return the lines of the method that gives the priors."""
        responses = " ".join(term.response for term in self.terms)
        used = [
            f"        {name} = scales.{name} / {name.upper()}"
            for name in ("depth", "speed", "acceleration")
            if re.search(rf"(?<![.\w]){name}\b", responses)
        ]
        priors = []
        for term in self.terms:
            sign = "signed" if term.signed else "positive"
            priors.append(f"            scales.{sign}({_product(f'{_WIDE} * {term.response}')}),")
            priors += [f"            {one.prior}," for one in term.shapes]
        return [
            "    @classmethod",
            "    def default(cls, scales: Scales) -> Self:",
            '        """Return the law with sizes scaled by what one unit adds to the force."""',
            *used,
            "        return cls(",
            *priors,
            "        )",
        ]

    def _arguments(self, moved: str, *, clock: str) -> list[str]:
        """Return the lines that give the terms what they depend on."""
        values = " ".join(term.value for term in self.terms)
        known = {
            "depth": f"xp.abs({moved}.displacement) / DEPTH",
            "velocity": f"{moved}.velocity / SPEED",
            "acceleration": f"{moved}.acceleration / ACCELERATION",
            "clock": f"{clock} / CLOCK",
            "tests": "motion.tests_before",
        }
        return [
            f"        {name} = {text}"
            for name, text in known.items()
            if re.search(rf"\b{name}\b", values)
        ]

    def _memory(self, k: int) -> str:
        return f"fading(1.0, 1.0 / self.{self.own('tau', k)})"

    def _composed(self, force: str, beneath: list[str]) -> list[str]:
        """Return the lines from the force beneath to what the method returns."""
        lines, added = list(beneath), []
        for k, term in zip(self.numbers, self.terms, strict=True):
            value = self._value(term, k)
            if term.enters == "factor":
                lines.append(f"        force = force * (1.0 + self.{self.own('k', k)} * {value})")
            elif term.enters != "shift":
                added.append(f"self.{self.own('k', k)} * {value}")
        total = " + ".join(["force", *added])
        return [*lines, f"        {force.format(total)}"]

    def _value(self, term: Term, k: int) -> str:
        constants = {one.name: f"self.{self.own(one.name, k)}" for one in term.shapes}
        value = re.sub(r"\bq\b", self.own("q", k), term.value.format(**constants))
        return f"({value})" if " + " in value else value

    def _shift(self, moved: str) -> str:
        """Return the displacement, an expression, less the shifts."""
        shifts = [
            f" - self.{self.own('k', k)} * DEPTH * {self._value(term, k)}"
            for k, term in zip(self.numbers, self.terms, strict=True)
            if term.enters == "shift"
        ]
        return moved + "".join(shifts)

    @property
    def _shifts(self) -> bool:
        return any(term.enters == "shift" for term in self.terms)

    def _force(self) -> list[str]:
        """Return the lines of the method that gives the force of a whole motion."""
        lines = ["        moved = motion.alone"] if self.remembering else []
        for k, term in zip(self.numbers, self.terms, strict=True):
            if term.memory is None:
                continue
            u, q = self.own("u", k), self.own("q", k)
            faded = f"hereditary_force(*{self._memory(k)}, moved.time, {u} - {u}[0])"
            lines += [
                f"        {u} = {term.memory.along}",
                f"        {q} = {u} - {faded}" if term.memory.lags else f"        {q} = {faded}",
            ]
        lines += self._arguments("motion", clock="motion.clock")
        below = "        force = below.force(motion)"
        if self._shifts:
            lowered = self._shift("motion.displacement")
            below = f"        force = below.force(at_depth(motion, {lowered}))"
        return [
            "    def force(self, below: Law, motion: Motion) -> Array:",
            '        """Return the force with the law added."""',
            *self._composed("return {}", [*lines, below]),
        ]

    def _begin(self) -> list[str]:
        """Return the lines of the method that gives the first state."""
        memories = [term.memory for term in self.terms if term.memory is not None]
        own = [f"Relaxing({one.first}, np.zeros(1))" for one in memories]
        extra = [*own, *(["xp.zeros_like(displacement)"] if self.clocked else [])]
        if self._places:
            extra.append("displacement")
        first = "displacement"
        lines = []
        if self._shifts:
            for k, term in zip(self.numbers, self.terms, strict=True):
                if term.memory is not None:
                    none = "xp.zeros_like(displacement)"
                    value = term.memory.first if term.memory.lags else none
                    lines.append(f"        {self.own('q', k)} = {value}")
            first = f"xp.maximum({self._shift('displacement')}, 0.0)"
        inner = f"below.begin({first})"
        return [
            "    def begin(self, below: Law, displacement: Array) -> State:",
            '        """Return the state of the law beneath, and what the law remembers."""',
            *lines,
            f"        return {inner}" + "".join(f", {one}" for one in extra),
        ]

    @property
    def _places(self) -> bool:
        """True if a memory needs the last displacement."""
        return any(t.memory and re.search(r"\bplace\b", t.memory.after) for t in self.terms)

    def _step(self) -> list[str]:
        """Return the lines of the method that goes one line further."""
        owns = [self.own("own", k) for k in self.remembering]
        names = [
            *owns,
            *(["clock_s"] if self.clocked else []),
            *(["place"] if self._places else []),
        ]
        lines = [f"        inner, {', '.join(names)} = state"] if names else []
        for k, term in zip(self.numbers, self.terms, strict=True):
            if term.memory is None:
                continue
            own, u, q = self.own("own", k), self.own("u", k), self.own("q", k)
            after = re.sub(r"\bwas\b", f"{own}.depth", term.memory.after)
            stepped = f"hereditary_step(*{self._memory(k)}, {own}, line.duration, {u})"
            lines += [
                f"        {u} = {after}",
                f"        {own}, {q} = {stepped}",
                *([f"        {q} = {u} - {q}"] if term.memory.lags else []),
            ]
        lines += ["        clock_s = clock_s + line.duration"] if self.clocked else []
        lines += self._arguments("line", clock="clock_s")
        line = (
            f"line_at_depth(line, {self._shift('line.displacement')})" if self._shifts else "line"
        )
        state = "inner" if names else "state"
        beneath = f"        {state}, force = below.step({state}, {line})"
        kept = [*owns, *(["clock_s"] if self.clocked else [])]
        kept += ["line.displacement"] if self._places else []
        returned = f"({', '.join(['inner', *kept])})" if names else "state"
        return [
            "    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:",
            '        """Return the state and the force with the law added."""',
            *self._composed(f"return {returned}, {{}}", [*lines, beneath]),
        ]


def _product(text: str) -> str:
    """Return a product without factors of one."""
    factors = [one for one in text.split(" * ") if one != "1.0"]
    return " * ".join(factors) or "1.0"
