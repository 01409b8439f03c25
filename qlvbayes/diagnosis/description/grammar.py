r"""The terms of which a described law is made: forces, factors and shifts of depth.

With d the depth over a reference depth D, v the speed over a reference speed V, and k the amplitude
of a term, a term is one of

* a rate term, :math:`F \mathrel{+}= k\, g(d)\, h(v)` with g one of 1, d, d^2, d^3 and
  :math:`e^{a(d - 1)}`, and h one of sgn v, :math:`|v|^n` sgn v, v, v^2 sgn v and the acceleration;
* a memory term, with :math:`\dot q = (u - q)/\tau` and u the depth, the elastic force, the
  velocity, the speed or the largest depth so far. It enters as a force k q, as a factor 1 + k q of
  the force beneath, or as a shift of the depth by -k D q;
* a term of the clock: a force or a factor that grows with the time since the pad's first test or
  with the number of tests before.

Every term is causal and physical in its arguments; a rate term takes energy, so k is zero or more.
The reference values make k the force (N) that a term adds at the pad's own depth and speed.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from qlvbayes.inference.density import Density
from qlvbayes.inference.modes import Mode
from qlvbayes.inference.starts import over_shapes, transferred
from qlvbayes.io.arrays import Array

_SAME = 0.9999  # cosine of two columns from which they are one: off the pad nothing was measured


@dataclass(frozen=True)
class Shape:
    """A constant of a term other than its amplitude.

    ``prior`` is the expression of its prior, in terms of ``scales``.
    """

    name: str
    unit: str
    words: str
    prior: str


@dataclass(frozen=True)
class Memory:
    """Quantity that a memory follows.

    In expressions ``moved`` is the motion or the line, ``below`` the law beneath. ``lags`` says
    whether the memory approaches what it follows, or else fades after its changes.
    """

    name: str
    formula: str
    along: str  # what is followed at all points of a motion
    first: str  # the same at the first displacement
    # the same after a line, from its last value, and ``place``, the last depth
    after: str
    lags: bool


@dataclass(frozen=True)
class Term:
    """One term of a described law, with the text of its formula and of its code.

    ``value`` is the expression that the amplitude multiplies, ``response`` its largest value at
    given scales (of ``depth``, ``speed``, ``acceleration`` over the references). In each text
    ``{n}`` stands for the number of the term, which ends the names of its constants.
    """

    name: str
    family: str  # for reports of how much each family could explain
    enters: str  # as a "force", a "factor" or a "shift"; as a force also off the pad: "guide"
    formula: str
    value: str
    response: str
    shapes: tuple[Shape, ...] = ()
    memory: Memory | None = None
    signed: bool = True
    needs: str = "displacement"
    stepped: bool = True
    number: str = ""  # "1" or "2" in a law of two terms

    def numbered(self, number: str) -> Term:
        """Return the term with a number on its constants."""
        memory = self.memory
        if memory is not None:
            memory = replace(memory, after=memory.after.replace("{n}", number))
        formula, value = (text.replace("{n}", number) for text in (self.formula, self.value))
        return replace(self, number=number, formula=formula, value=value, memory=memory)

    def joins(self, other: Term) -> bool:
        """Return whether both may be terms of one law: they act at places that one layer holds."""
        places = {self.enters, other.enters}
        return len(places) == 1 or places <= {"force", "factor"} or places <= {"shift", "factor"}


_DEPTHS = (
    ("", "", "", "1.0", ()),
    ("_of_depth", " d", " * depth", "depth", ()),
    ("_of_depth_squared", " d^2", " * depth**2", "depth**2", ()),
    ("_of_depth_cubed", " d^3", " * depth**3", "depth**3", ()),
    (
        "_exponential_in_depth",
        " e^(a{n} (d - 1))",
        " * xp.exp(self.a{n} * (depth - 1.0))",
        "1.0",
        (Shape("a", "fraction", "growth over the reference depth", "HalfNormal(3.0)"),),
    ),
)
"""g(d): suffix of the name, formula, factor of the value, largest value, constants."""

_EXPONENT = Shape("n", "fraction", "exponent of the speed", "Uniform(0.05, 2.0)")

_SPEEDS = (
    ("sliding_friction", "sgn v", "xp.sign(velocity)", "1.0", ()),
    ("power_drag", "|v|^n{n} sgn v", "_power(velocity, self.n{n})", "speed", (_EXPONENT,)),
    ("linear_drag", "v", "velocity", "speed", ()),
    ("quadratic_drag", "v^2 sgn v", "velocity * xp.abs(velocity)", "speed**2", ()),
    ("moving_mass", "acceleration", "acceleration", "acceleration", ()),
)
"""h(v): name, formula, value, largest value, constants."""

_MEMORIES = (
    Memory(
        "depth", "d", "moved.displacement / DEPTH", "displacement / DEPTH",
        "line.displacement / DEPTH", lags=True,
    ),
    Memory(
        "elastic_force", "elastic force", "below.elastic.force(moved.displacement) / FORCE",
        "below.elastic.force(displacement) / FORCE",
        "below.elastic.force(line.displacement) / FORCE", lags=True,
    ),
    Memory(
        "largest_depth", "largest d", "largest(moved.displacement) / DEPTH",
        "displacement / DEPTH", "xp.maximum(own{n}.depth, line.displacement / DEPTH)", lags=True,
    ),
    Memory(
        "velocity", "dd/dt", "moved.displacement / DEPTH", "displacement / DEPTH",
        "line.displacement / DEPTH", lags=False,
    ),
    Memory(
        "speed", "|dd/dt|", "xp.cumsum(xp.abs(xp.steps(moved.displacement))) / DEPTH",
        "xp.zeros_like(displacement)", "own{n}.depth + xp.abs(line.displacement - place) / DEPTH",
        lags=False,
    ),
)  # fmt: skip

_ENTERS = (
    ("force", "F += k{n} q{n}", "1.0"),
    ("factor", "F *= 1 + k{n} q{n}", "scales.force"),
    ("shift", "delta -= k{n} D q{n}", "scales.stiffness * DEPTH"),
)
"""How a memory enters: as what, formula, and what one unit of it adds to the force (N)."""

_CLOCKS = (
    ("clock", "t/T", "clock", "1.0"),
    ("loadings", "ln(1 + number of tests before)", "xp.log1p(tests)", "2.0"),
)


def grammar() -> tuple[Term, ...]:
    """Return every term."""
    return (*_rate_terms(), *_memory_terms(), *_clock_terms())


def _rate_terms() -> Iterator[Term]:
    for speed, depth in product(_SPEEDS, _DEPTHS):
        name, formula, value, response, own = speed
        suffix, of_depth, factor, reached, growth = depth
        mass = name == "moving_mass"
        for enters in ("force", "guide") if not suffix else ("force",):
            off = enters == "guide"
            yield Term(
                ("rig_" if off else "") + name + suffix,
                "mass" if mass else "friction" if "sliding" in name else "drag",
                enters,
                f"F += k{{n}}{of_depth} {formula}" + (", also off the pad" if off else ""),
                value + factor,
                f"{response} * {reached}",
                (*own, *growth),
                signed=False,
                needs="acceleration" if mass else "velocity",
                stepped=not mass,
            )


def _memory_terms() -> Iterator[Term]:
    for memory, (enters, formula, unit) in product(_MEMORIES, _ENTERS):
        yield Term(
            f"{enters}_of_remembered_{memory.name}",
            "memory",
            enters,
            f"{formula}, dq{{n}}/dt = {memory.formula} - q{{n}}/tau{{n}}"
            if not memory.lags
            else f"{formula}, dq{{n}}/dt = ({memory.formula} - q{{n}})/tau{{n}}",
            "q{n} * (depth > 0.0)"
            if enters == "force"
            else "q{n}",  # a pad off the platen adds none
            unit,
            (Shape("tau", "time", "memory", "LogUniform(*resolved_times(scales))"),),
            memory,
        )


def _clock_terms() -> Iterator[Term]:
    for (name, formula, value, reached), adds in product(_CLOCKS, (True, False)):
        yield Term(
            f"{'force' if adds else 'factor'}_of_{name}",
            "clock",
            "guide" if adds else "factor",  # a sensor drifts off the pad too
            f"F += k{{n}} {formula}, also off the pad" if adds else f"F *= 1 + k{{n}} {formula}",
            value,
            reached if adds else f"{reached} * scales.force",
            stepped=name == "clock",
        )


@dataclass(frozen=True, eq=False)
class Proposal:
    """A term at the shape and amplitude at which it explains most."""

    term: Term
    shape: Array  # (S,): the term's constants other than the amplitude, as parameters
    amplitude: float
    squares: float  # by which it reduces the sum of squares of the whitened residual


def proposals(
    density: Density, base: Mode, names: Mapping[Term, str], shapes: int
) -> list[Proposal]:
    r"""Return the terms at their best shapes, those that explain most first.

    Each term's force at a handful of its shapes, projected on what the constants at a mode can
    follow and weighted by the noise, is a column. With g and C the gradient and curvature that
    `Point.added_terms` gives for the amplitude k of a column, in sds of its prior, the term
    explains (the slab of a spike and slab; George & McCulloch 1993,
    doi:10.1080/01621459.1993.10476353)

    .. math:: \ln B = \frac{g^2}{2 (C + 1)} - \tfrac12 \ln(1 + C)

    more than none. A second term is proposed in the same way beside the first one as it was fitted:
    there are few enough terms to look at each, and no chain over sets of them is needed.
    """
    columns = [
        (term, *column)
        for term, name in names.items()
        for column in _columns(density, base, name, shapes)
    ]
    if not columns:
        return []
    terms, own_shapes, sds, forces = zip(*columns, strict=True)
    sized = density.discrepancy.at(base.size, base.point.separation)
    _, gradient, curvature = base.point.added_terms(density.whitener(np.stack(forces)), sized)
    own = np.maximum(np.diag(curvature), np.finfo(float).tiny)
    sizes = -gradient / (own + 1.0)
    gains = -0.5 * gradient * sizes - 0.5 * np.log1p(own)
    alike = np.abs(curvature) / np.sqrt(np.outer(own, own))
    kept: list[int] = []
    for k in np.argsort(-gains, kind="stable").tolist():
        known = any(terms[j] == terms[k] or alike[j, k] > _SAME for j in kept)
        if not known and (terms[k].signed or sizes[k] > 0.0):
            kept.append(k)
    squares = gradient**2 / own
    return [
        Proposal(terms[k], own_shapes[k], float(sizes[k]) * sds[k], float(squares[k])) for k in kept
    ]


def _columns(
    density: Density, base: Mode, name: str, shapes: int
) -> Iterator[tuple[Array, float, Array]]:
    """Yield the shapes of one term, the sd of its amplitude's prior, and block means (T, B) there.

    These forces are at one sd of the amplitude; shapes that add no finite force are left out.
    """
    space = density.space
    parameters = space.parameters(base.point.own.hypothesis.plus(name))
    amplitude = parameters.amplitude_of[name]
    theta = transferred(base.point.own, base.point.theta, parameters)
    none = np.stack(over_shapes(space, parameters, name, theta, shapes))
    leaves = [leaf for key, leaf in parameters.by_name.items() if key.startswith(f"{name}.")]
    own = [k for leaf in leaves if leaf.theta.start != amplitude.number for k in leaf.theta]
    forces = space.added_forces(parameters.hypothesis, none, amplitude.number, amplitude.sd)
    forces = np.where(space.real, forces, 0.0)
    for start, force in zip(none, forces, strict=True):
        if np.isfinite(force).all() and np.any(force):
            yield start[own], amplitude.sd, force
