"""Make classes of arrays: dataclasses that JAX takes apart and puts together as pytrees.

This is what ``equinox.Module`` is, without the wrapper that it puts around every method: a force is
asked for by several methods of every layer, ten thousand times in a diagnosis.
"""

from __future__ import annotations

from abc import ABC
from dataclasses import dataclass, field, fields
from functools import partial
from typing import Any, ClassVar, TypeVar, dataclass_transform

from jax.tree_util import GetAttrKey, register_pytree_with_keys

_Made = TypeVar("_Made")


def static(**options: Any) -> Any:
    """Return a field that is no array: it belongs to the structure of the pytree."""
    return field(metadata={"static": True}, **options)


def constant(unit: str, meaning: str, **options: Any) -> Any:
    """Return a field of a number or a prior: the kind of its unit, and what it means.

    The kind is a name that `UnitSystem.of` takes. A class has both by constant, as its ``units``
    and ``meanings``.
    """
    return field(metadata={"unit": unit, "meaning": meaning}, **options)


@dataclass_transform(eq_default=False, field_specifiers=(field, static, constant))
class Pytree(ABC):  # subclasses have the abstract methods
    """Base of classes of arrays; every subclass becomes a dataclass and a pytree of JAX.

    Fields are not changed once they are set: ``dataclasses.replace`` gives another object. A field
    made by `static`, or any with ``static`` in its metadata, is part of the structure. Putting an
    object together again from its leaves does not call its ``__init__``.
    """

    __dataclass_fields__: ClassVar[dict[str, Any]]
    _parts: ClassVar[tuple[tuple[str, ...], tuple[str, ...]]] = ((), ())

    def __init_subclass__(cls, **options: Any) -> None:
        """Make a dataclass of the subclass, and tell JAX of it."""
        super().__init_subclass__(**options)
        dataclass(eq=False)(cls)
        own = fields(cls)
        fixed = tuple(one.name for one in own if one.metadata.get("static", False))
        cls._parts = tuple(one.name for one in own if one.name not in fixed), fixed
        said = {one.name: one.metadata for one in own if "unit" in one.metadata}
        for attribute, word in (("units", "unit"), ("meanings", "meaning")):
            if said and attribute not in vars(cls):
                setattr(cls, attribute, {name: text[word] for name, text in said.items()})
        made = partial(_put_together, cls)
        register_pytree_with_keys(cls, _taken_apart_with_keys, made, _taken_apart)


def _taken_apart(tree: Pytree) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
    leaves, fixed = tree._parts
    held = tree.__dict__
    return tuple([held[name] for name in leaves]), tuple([held[name] for name in fixed])


def _taken_apart_with_keys(tree: Pytree) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
    values, fixed = _taken_apart(tree)
    return tuple(zip(map(GetAttrKey, tree._parts[0]), values, strict=True)), fixed


def _put_together(cls: type[_Made], fixed: tuple[Any, ...], values: Any) -> _Made:
    tree = object.__new__(cls)
    leaves, names = cls._parts  # type: ignore[attr-defined]
    tree.__dict__.update(zip(leaves, values, strict=True))
    tree.__dict__.update(zip(names, fixed, strict=True))
    return tree
