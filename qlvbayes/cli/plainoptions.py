"""Define options of commands that fit nothing, and groups of options, without JAX."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import MISSING, fields, is_dataclass
from functools import wraps
from inspect import Parameter, signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

import typer

if TYPE_CHECKING:
    from qlvbayes.io.data import Measurements, Pad

Pads = Annotated[str, typer.Option(help="Only these pads, as 'B,C'.")]
KeepAllReadings = Annotated[
    bool,
    typer.Option(
        "--keep-all-readings",
        help="Keep readings that their neighbours and the other channel contradict: lost ones, "
        "spikes, a stuck or clipped channel. Default: they are left out and named.",
    ),
]

Use = Annotated[
    list[str] | None,
    typer.Option(
        help="The part of a test that is used, as 'TEST:0..18mm' or 'TEST:0..12s': what lies "
        "before and behind it is left out; repeatable.",
        show_default=False,
    ),
]
LeaveOut = Annotated[
    list[str] | None,
    typer.Option(
        help="A part of a test whose force does not count while its motion does, as "
        "'TEST:30..45s', 'TEST:0..0.1mm' or 'TEST:hold 2'; repeatable.",
        show_default=False,
    ),
]


def _use_style(context: typer.Context, file: Path | None) -> Path | None:
    """Draw all figures of the command in the user's own style."""
    if file is not None:
        # imported here, so that commands do not wait for matplotlib
        from qlvbayes.plots.style import using

        context.with_resource(using(file))
    return file


Style = Annotated[
    Path | None,
    typer.Option(
        callback=_use_style,
        help="A Matplotlib style file (.mplstyle) for the figures, over the package's own.",
        show_default=False,
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON.")]


def split_names(text: str) -> list[str]:
    """Return the names in ``A, B`` as a list."""
    return [name.strip() for name in text.split(",") if name.strip()]


def among(text: str, known: Collection[str]) -> list[str]:
    """Return the names in ``A, B`` as a list; a known name may contain commas itself."""
    parts, names = text.split(","), []
    while parts:
        ends = range(len(parts), 1, -1)
        end = next((k for k in ends if ",".join(parts[:k]).strip() in known), 1)
        names.append(",".join(parts[:end]).strip())
        parts = parts[end:]
    return [name for name in names if name]


def chosen_pads(study: Measurements, names: str) -> list[Pad]:
    """Return the named pads, or all; raise InputError on an unknown name."""
    known = [pad.name for pad in study.pads]
    return [study.pad(name) for name in among(names, known)] or list(study.pads)


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
