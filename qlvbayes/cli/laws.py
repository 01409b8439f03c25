"""``qlvbayes laws``: the elastic laws and relaxations to choose from."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from rich.table import Table

from qlvbayes.cli.console import out
from qlvbayes.cli.options import AsJson, LawsFile
from qlvbayes.io.units import PAD

if TYPE_CHECKING:
    from qlvbayes.laws.elastic.law import AbstractElastic
    from qlvbayes.laws.relaxation.law import AbstractRelaxation

    Kind = type[AbstractElastic] | type[AbstractRelaxation]


def laws(laws_file: LawsFile = None, as_json: AsJson = False) -> None:
    """List the laws by name, with equation, constants and source."""
    from qlvbayes.model.choices import Choices  # here, so that the help does not wait for it

    own = None if laws_file is None else str(laws_file.resolve())
    known = Choices(laws_file=own).laws
    every: dict[str, tuple[Kind, ...]] = {
        "--elastic": known.elastic,
        "--relaxation": known.relaxation,
    }
    if as_json:
        print(json.dumps([_entry(at, kind) for at, kinds in every.items() for kind in kinds]))
        return
    for option, kinds in every.items():
        table = Table(show_lines=True)
        for name in (option, "law", "constants", "reference"):
            table.add_column(name, overflow="fold", no_wrap=name == option)
        for kind in kinds:
            table.add_row(kind.name, kind.law, "\n".join(_constants(kind)), kind.reference)
        out.print(table)


def _constants(kind: Kind) -> list[str]:
    units = {name: PAD.of(word) for name, word in kind.units.items()}
    return [
        f"{name}{'' if unit == '1' else f' ({unit})'}: {kind.meanings[name]}"
        for name, unit in units.items()
    ]


def _entry(option: str, kind: Kind) -> dict:
    return {
        "option": option,
        "name": kind.name,
        "law": kind.law,
        "parameters": {name: PAD.of(word) for name, word in kind.units.items()},
        "reference": kind.reference,
    }
