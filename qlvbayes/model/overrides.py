"""Apply a user's settings of single constants: ``v[1]=lognormal(1.8,0.5)``, ``v[2]=0.14``."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import fields
from typing import TypeVar

import jax
import numpy as np

from qlvbayes.io.checks import InputError, meant
from qlvbayes.model.parameters import Field, fields_of, is_prior
from qlvbayes.priors import (
    AbstractPositivePrior,
    AbstractPrior,
    AbstractScalarPrior,
    Dirichlet,
    HalfNormal,
    LogNormal,
    LogUniform,
    Normal,
    Ordered,
    Uniform,
)
from qlvbayes.pytree import Pytree

WORDS: dict[str, type[AbstractScalarPrior]] = {
    kind.word: kind for kind in (Normal, LogNormal, HalfNormal, Uniform, LogUniform)
}
_PRIOR = re.compile(r"\s*([a-z]+)\s*\(([^()]*)\)\s*")
_NAME = re.compile(r"\s*([A-Za-z_][\w.]*)(?:\[(\d+)\])?\s*")

Part = TypeVar("Part", bound=Pytree)


def parse(text: str, *, fixed: bool) -> tuple[str, AbstractPrior | float]:
    """Return ``name=prior`` or, with ``fixed``, ``name=number`` as a pair."""
    name, equals, value = text.partition("=")
    if not equals or not _NAME.fullmatch(name):
        example = "v[2]=0.14" if fixed else "v[1]=lognormal(1.8,0.5)"
        raise InputError(f"{text!r} is not name=value", remedy=f"write for example {example!r}")
    return name.strip(), _number(value) if fixed else parse_prior(value)


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"{text.strip()!r} is not a finite number", remedy="write a number")
    return value


def parse_prior(text: str) -> AbstractPrior:
    """Return a prior from its description, as ``lognormal(1.8, 0.5)`` or ``dirichlet(1,1,1)``."""
    match = _PRIOR.fullmatch(text)
    known = ", ".join([*WORDS, "dirichlet"])
    if not match:
        raise InputError(f"{text.strip()!r} is not a prior", remedy=f"use one of {known}")
    word, arguments = match[1], [_number(x) for x in match[2].split(",")]
    if word == "dirichlet":
        if min(arguments) <= 0.0 or len(arguments) < 2:
            raise InputError(f"{text.strip()!r} needs two or more positive numbers")
        return Dirichlet(arguments)
    if word not in WORDS:
        remedy = f"{meant(word, WORDS)}use one of {known}"
        raise InputError(f"no prior is called {word!r}", remedy=remedy)
    kind = WORDS[word]
    wanted = [field.name for field in fields(kind)]
    if len(arguments) != len(wanted):
        raise InputError(
            f"{word} takes {', '.join(wanted)}", remedy=f"got {len(arguments)} numbers"
        )
    return _checked(kind(*arguments), text.strip())


def in_words(value: AbstractPrior | float | str) -> str:
    """Return a prior or number as text that `parse` reads, to the last digit."""
    if isinstance(value, str):
        return value
    if not isinstance(value, AbstractPrior):
        return repr(float(value))
    if isinstance(value, Dirichlet) and len(value.free) == value.alpha.shape[0]:
        word, arguments = "dirichlet", list(value.alpha)
    elif isinstance(value, AbstractScalarPrior) and WORDS.get(value.word) is type(value):
        word, arguments = value.word, [getattr(value, field.name) for field in fields(value)]
    else:
        raise InputError(
            f"{type(value).__name__} cannot be kept with the results",
            remedy=f"use one of {', '.join([*WORDS, 'dirichlet'])}, and fixed for single fractions",
        )
    return f"{word}({','.join(repr(float(x)) for x in arguments)})"


def _checked(prior: AbstractScalarPrior, text: str) -> AbstractScalarPrior:
    for name in ("sd", "log_sd"):
        if getattr(prior, name, 1.0) <= 0.0:
            raise InputError(f"{text}: {name} must be positive")
    if isinstance(prior, (Uniform, LogUniform)) and not prior.low < prior.high:
        raise InputError(f"{text}: the lower bound must be below the upper one")
    if isinstance(prior, LogUniform) and prior.low <= 0.0:
        raise InputError(f"{text}: the lower bound must be positive")
    return prior


def override(part: Part, settings: Iterable[tuple[str, AbstractPrior | float]]) -> Part:
    """Return ``part`` (a model or noise) with fields replaced; unknown names are refused."""
    for name, value in settings:
        known = list(fields_of(part))
        match = _NAME.fullmatch(name)
        stem, index = (match[1], match[2]) if match else (name, None)
        number = next((k for k, field in enumerate(known) if field.name == stem), None)
        if number is None or (index is not None and not known[number].shape):
            names = [n for field in known for n in field.names]
            remedy = f"{meant(name, names)}use one of {', '.join(names)}"
            raise InputError(f"no constant is called {name!r}", remedy=remedy)
        leaves, structure = jax.tree.flatten(part, is_leaf=is_prior)  # in the order of the fields
        leaves[number] = _replacement(known[number], None if index is None else int(index), value)
        part = jax.tree.unflatten(structure, leaves)
    return part


def _replacement(field: Field, index: int | None, value: AbstractPrior | float) -> object:
    """Return what the field holds once ``value`` is set at ``index``."""
    if index is not None and f"{field.name}[{index}]" not in field.names:
        raise InputError(
            f"no constant is called {field.name}[{index}]",
            remedy=f"use one of {', '.join(field.names)}",
        )
    if not field.shape:
        return _scalar(field, value)
    if isinstance(field.value, Dirichlet):
        return _simplex(field.value, index, value)
    if isinstance(field.value, Ordered):
        return _ordered(field, index, value)
    raise InputError(f"{field.name} is fixed already")


def _scalar(field: Field, value: AbstractPrior | float) -> object:
    if isinstance(value, AbstractPrior) and not isinstance(value, AbstractScalarPrior):
        raise InputError(f"{field.name} is one number", remedy="give it a prior of one number")
    if isinstance(field.value, AbstractPositivePrior):
        _require_positive(field.name, value)
    return value


def _require_positive(name: str, value: AbstractPrior | float) -> None:
    """Refuse a prior or number that allows values which are not positive."""
    if isinstance(value, AbstractPositivePrior):
        return
    low = value.low if isinstance(value, (Uniform, LogUniform)) else value
    if isinstance(low, AbstractPrior) or low < 0.0 or (low == 0.0 and low is value):
        raise InputError(
            f"{name} must be positive",
            remedy="use lognormal, halfnormal, loguniform or a positive number",
        )


def _simplex(old: Dirichlet, index: int | None, value: AbstractPrior | float) -> Dirichlet:
    size = old.alpha.shape[0]
    fixed = {i: float(old.values[i]) for i in range(size) if i not in old.free}
    if index is None:
        if not isinstance(value, Dirichlet) or value.alpha.shape[0] != size:
            raise InputError(f"c needs {size} concentrations", remedy="write c=dirichlet(1,1,1)")
        return Dirichlet(value.alpha, fixed)
    if isinstance(value, AbstractPrior):
        raise InputError(
            "the fractions c sum to one and share a prior",
            remedy="write c=dirichlet(1,1,1), or fix single ones",
        )
    fixed[index] = value
    if not 0.0 <= value < 1.0 or sum(fixed.values()) >= 1.0 or len(fixed) > size - 2:
        raise InputError(
            "fixed fractions must lie in [0, 1), sum to less than one and leave two free",
            remedy="fix fewer or smaller fractions",
        )
    return Dirichlet(old.alpha, fixed)


def _ordered(field: Field, index: int | None, value: AbstractPrior | float) -> Ordered:
    if index is None:
        raise InputError(f"{field.name} has several members", remedy=f"name {field.names[0]}")
    name = f"{field.name}[{index}]"
    _require_positive(name, value)
    if isinstance(value, AbstractPrior) and not isinstance(value, AbstractPositivePrior):
        raise InputError(
            f"{name}: rates are ordered and need a prior on all positive numbers",
            remedy="use lognormal or halfnormal",
        )
    members = list(field.value.members)
    members[index - field.first_index] = value
    fixed = [float(x) for x in members if not isinstance(x, AbstractPrior)]
    if any(np.diff(fixed) >= 0.0):
        raise InputError("rates must fall: v[1] > v[2] > ...", remedy="exchange the fixed rates")
    return Ordered(tuple(members))
