"""``qlvbayes effects``: what can be added to the model."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from rich.table import Table

from qlvbayes.cli.console import out
from qlvbayes.cli.options import AsJson, EffectsFile
from qlvbayes.io.units import PAD

if TYPE_CHECKING:
    from qlvbayes.effects.effect import AbstractEffect


def effects(effects_file: EffectsFile = None, as_json: AsJson = False) -> None:
    """List the effects by family, with law, constants and what one would see.

    Below each effect are its other forms. Those that name no physical cause come last.
    """
    # imported here, so that the help does not wait for them
    from qlvbayes.effects.catalogue import by_family
    from qlvbayes.model.choices import Choices

    own = None if effects_file is None else str(effects_file.resolve())
    families = by_family(Choices(effects_file=own).kinds)
    kinds = [kind for members in families.values() for kind in members]
    if as_json:
        print(json.dumps([_entry(kind) for kind in kinds]))
        return
    table = Table(show_lines=True, caption="indented: another form of the effect above it")
    for name in ("effect", "law", "constants", "what you would see"):
        table.add_column(name, overflow="fold", no_wrap=name == "effect")
    for kind in kinds:
        name = f"  {kind.name}" if kind.generalises else kind.name
        table.add_row(name, kind.law, ", ".join(_constants(kind)), kind.seen)
    out.print(table)


def _constants(kind: type[AbstractEffect]) -> list[str]:
    units = {name: PAD.of(word) for name, word in kind.units.items()}
    return [name if unit == "1" else f"{name} ({unit})" for name, unit in units.items()]


def _entry(kind: type[AbstractEffect]) -> dict:
    return {
        "effect": kind.name,
        "family": kind.family(),
        "outside": kind.outside,
        "law": kind.law,
        "parameters": {name: PAD.of(word) for name, word in kind.units.items()},
        "seen": kind.seen,
        "reference": kind.reference,
    }
