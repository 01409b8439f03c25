"""The commands as the terminal's help shows them."""

from __future__ import annotations

import inspect
from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Option:
    """An argument or option of a command: how it is written, what it says, its default."""

    written: str
    help: str
    default: str


@dataclass(frozen=True)
class Command:
    """A command: its name, its help and its options."""

    name: str
    help: str
    arguments: list[Option]
    options: list[Option]


def commands() -> list[Command]:
    """Every command as the terminal's help shows it."""
    import typer

    from qlvbayes.cli.main import application

    group: Any = typer.main.get_command(application())
    return [_command(name, command) for name, command in group.commands.items()]


def _command(name: str, command: Any) -> Command:
    by_kind: dict[str, list[Option]] = {"argument": [], "option": []}
    for parameter in command.params:
        by_kind[parameter.param_type_name].append(_option(parameter))
    return Command(name, _plain(inspect.cleandoc(command.help or "")), *by_kind.values())


def _plain(text: str) -> str:
    """Text in which ``<pad>`` is no tag of HTML."""
    return text.replace("<", "&lt;")


def _option(parameter: Any) -> Option:
    words = _plain(parameter.help or "")
    if parameter.param_type_name == "argument":
        return Option(parameter.name.upper(), words, "")
    written = ", ".join((*parameter.opts, *parameter.secondary_opts))
    default = parameter.default
    plain = isinstance(default, (str, int, float, Path)) and not isinstance(default, bool)
    shown = "required" if parameter.required else str(default) if plain else ""
    return Option(written, words, shown)
