"""Write a described law as a Python file of one effect, and load the effect from it.

The template ``described_effect.py.j2`` is the file. What is fitted is the class of the file itself,
so that what a user adds is what was judged.
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from hashlib import sha256
from types import ModuleType

from jinja2 import Environment, PackageLoader, StrictUndefined

from qlvbayes.diagnosis.description.grammar import Term
from qlvbayes.effects.effect import AbstractEffect
from qlvbayes.io.units import UnitSystem
from qlvbayes.laws.scales import Scales

_WIDE = 0.3
"""Share of a term's response for which its prior is made: a sixth of the peak force, three times as
much as a listed effect's, since something that large was seen to be left."""
_LEVELS = {"shift": "DEPTH", "guide": "GUIDE", "force": "ADDING", "factor": "SCALING"}
"""Where a law acts; of two terms the first one in this order decides."""
_KINDS = {"force": "force", "guide": "force", "factor": "fraction", "shift": "fraction"}
_IMPORTS = {
    "qlvbayes.effects.effect": ("AbstractEffect", "Level"),
    "qlvbayes.effects.history": ("fading", "largest", "resolved_times"),
    "qlvbayes.laws.hereditary": ("Relaxing", "hereditary_force", "hereditary_step"),
    "qlvbayes.laws.layered": ("Law", "State", "at_depth", "line_at_depth"),
    "qlvbayes.laws.motion": ("Line", "Motion"),
    "qlvbayes.laws.scales": ("Scales",),
    "qlvbayes.priors": ("HalfNormal", "LogUniform", "Uniform"),
    "qlvbayes.priors.distributions": ("Constant",),
    "qlvbayes.xp": ("Array",),
}
"""What a file may import: modules and names."""


def _is_used(name: str, text: str) -> bool:
    """Return whether a name is a word of a text."""
    return re.search(rf"\b{name}\b", text) is not None


_FILES = Environment(
    loader=PackageLoader("qlvbayes.diagnosis.description"),
    trim_blocks=True,
    lstrip_blocks=True,
    undefined=StrictUndefined,
)
_FILES.tests["used_in"] = _is_used
_FILES.filters["json"] = json.dumps


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
    text = "; ".join(term.formula for term in _numbered(terms))
    used = [
        f"{symbol} = {value}"
        for symbol, value in where.items()
        if re.search(rf"(?<![a-zA-Z]){symbol}(?![a-zA-Z])", text.replace("dd/", "d/"))
    ]
    return text + (f" (with {', '.join(used)})" if used else "")


def _numbered(terms: Sequence[Term]) -> list[Term]:
    """Return the terms of a law with numbers on their constants, where there are two."""
    return [one.numbered(str(k) if len(terms) > 1 else "") for k, one in enumerate(terms, 1)]


ADDED_BY = "COMMAND"
"""What stands in a law's file for the command that adds it, which the whole diagnosis knows."""


def source_of(terms: Sequence[Term], references: References, units: UnitSystem, about: str) -> str:
    """Return the text of a file that holds the law as one effect; ``about`` ends its docstring."""
    depth, enters = units.displacement, {term.enters for term in terms}
    constants: dict[str, str] = {}
    for term in (own := _numbered(terms)):
        constants[f"k{term.number}"] = _KINDS[term.enters]
        constants |= {f"{one.name}{term.number}": one.unit for one in term.shapes}
    of_references = (depth, units.of("speed"), f"{depth}/s2", units.force, "s")
    return _FILES.get_template("described_effect.py.j2").render(
        terms=own,
        name=name_of(terms),
        title="".join(word.capitalize() for word in name_of(terms).split("_")),
        formula=formula_of(terms, references, units),
        about=about,
        level=next(level for one, level in _LEVELS.items() if one in enters),
        constants=constants,
        null={f"k{term.number}": 0.0 for term in own},
        references=[
            (name.upper(), value, unit)
            for (name, value), unit in zip(asdict(references).items(), of_references, strict=True)
        ],
        units=units,
        kinds=_KINDS,
        wide=_WIDE,
        imports=_IMPORTS,
    )


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
