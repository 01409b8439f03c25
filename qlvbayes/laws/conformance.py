"""The rules that every law keeps, as one function to be called in a test."""

from __future__ import annotations

import inspect
from dataclasses import fields
from typing import TypeVar

import jax
import numpy as np

from qlvbayes.io.units import PAD
from qlvbayes.laws.checkelastic import check_elastic
from qlvbayes.laws.checkrelaxation import check_relaxation
from qlvbayes.laws.elastic.law import AbstractElastic
from qlvbayes.laws.lawerror import LawError
from qlvbayes.laws.relaxation.law import AbstractRelaxation
from qlvbayes.laws.scales import Scales
from qlvbayes.priors.distributions import AbstractPrior

Law = TypeVar("Law", bound=AbstractElastic | AbstractRelaxation)

_DRAWS = 16
# those of the paper's tests, where no others are given
_SCALES = Scales(force=1.6, depth=1.6, shortest=1e-3, longest=30.0, white=6e-3, ou=8e-3, tau=0.5)


def check_law(
    kind: type[AbstractElastic] | type[AbstractRelaxation], scales: Scales | None = None
) -> None:
    """Check that an elastic law or a relaxation keeps the rules on which the model relies.

    It declares itself. Under its default priors (at ``scales``, by default the paper's tests) an
    elastic law has no force at zero depth, a stiffness that is the slope of its force, and a step
    that is the integral it stands for; a relaxation has g(0) = 1, fractions that are not negative
    and sum to 1, finite rates above 0, as many whatever the constants, and falls. Values and slopes
    are finite; compiled and plain evaluation agree.

    Parameters
    ----------
    kind
        The law's class.
    scales
        Of the tests.

    Raises
    ------
    LawError
        A rule is broken; the text says which.
    """
    _check_declarations(kind)
    scales = scales or _SCALES
    rng = np.random.default_rng(0)
    laws = [_drawn(kind.default(scales), rng) for _ in range(_DRAWS)]
    for law in laws:
        if isinstance(law, AbstractElastic):
            check_elastic(law, scales.depth)
        else:
            check_relaxation(law, scales.shortest, scales.longest)


def _drawn(law: Law, rng: np.random.Generator) -> Law:
    """The law with numbers from its priors."""
    leaves, shape = jax.tree.flatten(law, is_leaf=lambda x: isinstance(x, AbstractPrior))
    drawn = [np.asarray(x.draw(rng)) if isinstance(x, AbstractPrior) else x for x in leaves]
    return jax.tree.map(jax.numpy.asarray, jax.tree.unflatten(shape, drawn))


def _check_declarations(kind: type[AbstractElastic] | type[AbstractRelaxation]) -> None:
    if inspect.isabstract(kind):
        missing = ", ".join(sorted(kind.__abstractmethods__))
        raise LawError(f"{kind.__name__} lacks {missing}")
    own = {f.name for f in fields(kind) if not f.metadata.get("static", False)}
    for word in ("units", "meanings"):
        if set(getattr(kind, word)) != own:
            listed = ", ".join(sorted(own))
            raise LawError(f"{kind.name}: {word} must name exactly its constants {listed}")
    for constant, unit in kind.units.items():
        if not _is_unit(unit):
            raise LawError(f"{kind.name}: {unit!r} is no kind of unit (units[{constant!r}])")
    for word in ("name", "law", "reference"):
        text = getattr(kind, word)
        if not text.strip() or "\n" in text:
            raise LawError(f"{kind.__name__}: {word} must be one line of text")


def _is_unit(unit: str) -> bool:
    try:
        PAD.of(unit)
    except AttributeError:
        return False
    return True
