"""``qlvbayes effects``: what can be added to the model, and the laws to choose from."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from qlvbayes.cli.console import out, table
from qlvbayes.io.units import PAD

if TYPE_CHECKING:
    from qlvbayes.effects.effect import AbstractEffect
    from qlvbayes.laws.elastic.law import AbstractElastic
    from qlvbayes.laws.relaxation.law import AbstractRelaxation

    Law = type[AbstractElastic] | type[AbstractRelaxation]


def effects(
    name: str = "", laws: bool = False, own: Path | None = None, as_json: bool = False
) -> None:
    """List the effects by family, with law, constants and what one would see.

    Below each effect are its other forms. Those that name no physical cause come last. An effect
    that acts off the pad adds a force also where the platen does not touch it.

    Options:
    name NAME: Only this effect and its other forms.
    laws: List elastic laws and relaxations, with their source.
    own --effects-file --laws-file: A Python file with effects of your own, or with --laws with
        laws.
    """
    # imported here, so that the help does not wait for it
    from qlvbayes.model.choices import Choices

    path = None if own is None else str(own.resolve())
    if laws:
        known = Choices(laws_file=path).laws
        _show_laws({"--elastic": known.elastic, "--relaxation": known.relaxation}, as_json=as_json)
    else:
        _show_effects(name, Choices(effects_file=path).kinds, as_json=as_json)


def _show_effects(name: str, known: Sequence[type[AbstractEffect]], *, as_json: bool) -> None:
    from qlvbayes.effects.catalogue import by_family, find

    families = by_family(known)
    wanted = [find(name, known).family()] if name else list(families)
    kinds = [kind for family in wanted for kind in families[family]]
    if as_json:
        entries = [
            {"effect": kind.name, "family": kind.family(), "outside": kind.outside,
             "off_pad": kind.off_pad, "law": kind.law, "parameters": _units(kind),
             "seen": kind.seen, "reference": kind.reference}
            for kind in kinds
        ]  # fmt: skip
        print(json.dumps(entries))
        return
    made = table(
        "", "effect", "law", "constants", "what you would see", "off the pad", whole=("effect",),
        show_lines=True, caption="indented: another form of the effect above it",
    )  # fmt: skip
    for kind in kinds:
        shown = f"  {kind.name}" if kind.generalises else kind.name
        acts = "acts" if kind.off_pad else "-"
        made.add_row(shown, kind.law, ", ".join(_constants(kind)), kind.seen, acts)
    out.print(made)


def _show_laws(known: dict[str, tuple[Law, ...]], *, as_json: bool) -> None:
    """Show laws by the option that chooses them."""
    if as_json:
        entries = [
            {"option": option, "name": kind.name, "law": kind.law, "parameters": _units(kind),
             "reference": kind.reference}
            for option, kinds in known.items()
            for kind in kinds
        ]  # fmt: skip
        print(json.dumps(entries))
        return
    for option, kinds in known.items():
        made = table("", option, "law", "constants", "reference", whole=(option,), show_lines=True)
        for kind in kinds:
            meanings = [kind.meanings[name] for name in kind.units]
            constants = (f"{a}: {b}" for a, b in zip(_constants(kind), meanings, strict=True))
            made.add_row(kind.name, kind.law, "\n".join(constants), kind.reference)
        out.print(made)


def _units(kind: type[AbstractEffect] | Law) -> dict[str, str]:
    """Return the unit of each constant of a pad in mm and N."""
    return {name: PAD.of(word) for name, word in kind.units.items()}


def _constants(kind: type[AbstractEffect] | Law) -> list[str]:
    return [name if unit == "1" else f"{name} ({unit})" for name, unit in _units(kind).items()]
