"""``qlvbayes effects``: what can be added to the model, and the laws to choose from."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from qlvbayes.cli.console import out
from qlvbayes.cli.options import AsJson
from qlvbayes.io.units import PAD

if TYPE_CHECKING:
    from qlvbayes.effects.effect import AbstractEffect
    from qlvbayes.laws.elastic.law import AbstractElastic
    from qlvbayes.laws.relaxation.law import AbstractRelaxation

    Law = type[AbstractElastic] | type[AbstractRelaxation]

Name = Annotated[
    str, typer.Argument(help="Only this effect and its other forms.", show_default=False)
]


def effects(
    name: Name = "",
    laws: Annotated[
        bool,
        typer.Option("--laws", help="List elastic laws and relaxations, with their source."),
    ] = False,
    own: Annotated[
        Path | None,
        typer.Option(
            "--effects-file",
            "--laws-file",
            help="A Python file with effects of your own, or with --laws with laws.",
            show_default=False,
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """List the effects by family, with law, constants and what one would see.

    Below each effect are its other forms. Those that name no physical cause come last. An effect
    that acts off the pad adds a force also where the platen does not touch it.
    """
    if laws:
        _show_laws(own, as_json=as_json)
    else:
        _show_effects(name, own, as_json=as_json)


def _show_effects(name: str, effects_file: Path | None, *, as_json: bool) -> None:
    # imported here, so that the help does not wait for them
    from qlvbayes.effects.catalogue import by_family, find
    from qlvbayes.model.choices import Choices

    own = None if effects_file is None else str(effects_file.resolve())
    known = Choices(effects_file=own).kinds
    families = by_family(known)
    wanted = [find(name, known).family()] if name else list(families)
    kinds = [kind for family in wanted for kind in families[family]]
    if as_json:
        print(json.dumps([_effect_entry(kind) for kind in kinds]))
        return
    table = Table(show_lines=True, caption="indented: another form of the effect above it")
    for head in ("effect", "law", "constants", "what you would see", "off the pad"):
        table.add_column(head, overflow="fold", no_wrap=head == "effect")
    for kind in kinds:
        shown = f"  {kind.name}" if kind.generalises else kind.name
        acts = "acts" if kind.off_pad else "-"
        table.add_row(shown, kind.law, ", ".join(_constants(kind)), kind.seen, acts)
    out.print(table)


def _show_laws(laws_file: Path | None, *, as_json: bool) -> None:
    from qlvbayes.model.choices import Choices  # here, so that the help does not wait for it

    own = None if laws_file is None else str(laws_file.resolve())
    known = Choices(laws_file=own).laws
    every: dict[str, tuple[Law, ...]] = {
        "--elastic": known.elastic,
        "--relaxation": known.relaxation,
    }
    if as_json:
        print(json.dumps([_law_entry(at, kind) for at, kinds in every.items() for kind in kinds]))
        return
    for option, kinds in every.items():
        table = Table(show_lines=True)
        for name in (option, "law", "constants", "reference"):
            table.add_column(name, overflow="fold", no_wrap=name == option)
        for kind in kinds:
            meanings = [kind.meanings[name] for name in kind.units]
            constants = (f"{a}: {b}" for a, b in zip(_constants(kind), meanings, strict=True))
            table.add_row(kind.name, kind.law, "\n".join(constants), kind.reference)
        out.print(table)


def _constants(kind: type[AbstractEffect] | Law) -> list[str]:
    units = {name: PAD.of(word) for name, word in kind.units.items()}
    return [name if unit == "1" else f"{name} ({unit})" for name, unit in units.items()]


def _effect_entry(kind: type[AbstractEffect]) -> dict:
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


def _law_entry(option: str, kind: Law) -> dict:
    return {
        "option": option,
        "name": kind.name,
        "law": kind.law,
        "parameters": {name: PAD.of(word) for name, word in kind.units.items()},
        "reference": kind.reference,
    }
