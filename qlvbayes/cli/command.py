"""The class of all commands, and one option for each field of the groups of options they take."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import MISSING, fields, is_dataclass
from functools import wraps
from inspect import Parameter, signature
from pathlib import Path
from typing import Any, get_type_hints

from typer.core import TyperCommand

from qlvbayes.cli.settings import FILE, expanded, help_lines

STYLE = "--style FILE: a Matplotlib style file (.mplstyle) for the figures, over the package's own."


class Command(TyperCommand):
    """Command whose settings may be given as options, and whose figures take a style."""

    def __init__(self, *words: Any, **options: Any) -> None:
        if lines := help_lines(str(options.get("name"))):
            head = f"Settings, in {FILE} or as options:"
            options["epilog"] = "\n\n".join((head, *lines, STYLE))
        super().__init__(*words, **options)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the words of the command line."""
        return super().parse_args(ctx, expanded(self.name or "", self._without_style(ctx, args)))

    def _without_style(self, ctx: Any, args: list[str]) -> list[str]:
        """Draw all figures of the command in the style that ``--style`` names."""
        left = list(args)
        for place, word in enumerate(args):
            name, equals, file = word.partition("=")
            if name != "--style" or (not equals and place + 1 == len(args)):
                continue
            file = file if equals else args[place + 1]
            del left[place : place + (1 if equals else 2)]
            # imported here, so that commands do not wait for matplotlib
            from qlvbayes.plots.style import using

            ctx.with_resource(using(Path(file)))
            break
        return left


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
