"""``qlvbayes effects``: what can be added to the model."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from qlvbayes.cli.console import out
from qlvbayes.cli.options import AsJson, EffectsFile
from qlvbayes.io.units import PAD

if TYPE_CHECKING:
    from qlvbayes.effects.effect import AbstractEffect

Name = Annotated[
    str, typer.Argument(help="Only this effect and its other forms.", show_default=False)
]


def effects(name: Name = "", effects_file: EffectsFile = None, as_json: AsJson = False) -> None:
    """List the effects by family, with law, constants and what one would see.

    Below each effect are its other forms. Those that name no physical cause come last. An effect
    that acts off the pad adds a force also where the platen does not touch it.
    """
    # imported here, so that the help does not wait for them
    from qlvbayes.effects.catalogue import by_family, find
    from qlvbayes.model.choices import Choices

    own = None if effects_file is None else str(effects_file.resolve())
    known = Choices(effects_file=own).kinds
    families = by_family(known)
    wanted = [find(name, known).family()] if name else list(families)
    kinds = [kind for family in wanted for kind in families[family]]
    if as_json:
        print(json.dumps([_entry(kind) for kind in kinds]))
        return
    table = Table(show_lines=True, caption="indented: another form of the effect above it")
    for head in ("effect", "law", "constants", "what you would see", "off the pad"):
        table.add_column(head, overflow="fold", no_wrap=head == "effect")
    for kind in kinds:
        shown = f"  {kind.name}" if kind.generalises else kind.name
        acts = "acts" if kind.off_pad else "-"
        table.add_row(shown, kind.law, ", ".join(_constants(kind)), kind.seen, acts)
    out.print(table)


def _constants(kind: type[AbstractEffect]) -> list[str]:
    units = {name: PAD.of(word) for name, word in kind.units.items()}
    return [name if unit == "1" else f"{name} ({unit})" for name, unit in units.items()]


def _entry(kind: type[AbstractEffect]) -> dict:
    return {
        "effect": kind.name,
        "family": kind.family(),
        "outside": kind.outside,
        "off_pad": kind.off_pad,
        "law": kind.law,
        "parameters": {name: PAD.of(word) for name, word in kind.units.items()},
        "seen": kind.seen,
        "reference": kind.reference,
    }
