"""Give a command one option for each field of the groups of options that it takes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import MISSING, fields, is_dataclass
from functools import wraps
from inspect import Parameter, signature
from typing import Any, get_type_hints


def with_groups(command: Callable[..., None]) -> Callable[..., None]:
    """Return a command with one option for each field of those parameters that are groups.

    A group is a dataclass whose fields are options.
    """
    hints = get_type_hints(command, include_extras=True)
    groups: dict[str, Any] = {name: kind for name, kind in hints.items() if is_dataclass(kind)}
    single: dict[str, Parameter] = {}
    for name, one in signature(command).parameters.items():
        options = _options(groups[name]) if name in groups else {name: (hints[name], one.default)}
        for option, (hint, default) in options.items():
            single[option] = Parameter(
                option, Parameter.KEYWORD_ONLY, annotation=hint, default=default
            )

    @wraps(command)
    def run(**given: Any) -> None:
        made = {
            name: kind(**{option: given.pop(option) for option in _options(kind)})
            for name, kind in groups.items()
        }
        command(**given, **made)

    run.__signature__ = signature(command).replace(parameters=list(single.values()))  # type: ignore[attr-defined]
    run.__annotations__ = {name: one.annotation for name, one in single.items()}
    return run


def _options(group: Any) -> dict[str, tuple[Any, Any]]:
    """Return the type and the default of each option of a group, by name."""
    hints = get_type_hints(group, include_extras=True)
    return {
        one.name: (hints[one.name], Parameter.empty if one.default is MISSING else one.default)
        for one in fields(group)
    }
