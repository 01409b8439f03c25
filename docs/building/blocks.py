"""Write the blocks of the pages that are made from the code: python docs/building/blocks.py.

A block stands between ``<!-- generated: KIND OF -->`` and ``<!-- end -->``; all else on a page is
plain text. `make docs` writes the blocks, and a test holds them equal to the code. Likewise each
value after a name, as `` `named` = 0.9 ``, is that of the code.
"""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import re
import sys
import textwrap
from collections.abc import Collection, Iterator
from math import isclose
from pathlib import Path
from typing import Any

from records import record

DOCS = Path(__file__).parents[1]
_BLOCK = re.compile(r"(<!-- generated: (\w+)(?: (\S+))? -->\n).*?(<!-- end -->)", re.DOTALL)
_VALUE = re.compile(r"`([a-z_]+(?:\.\w+)*)` = (-?\d[\d.e-]*\d|\d)")
_MATH = re.compile(r"^\.\. math::[ \t]*(.*\n?(?:(?:[ \t]+\S.*|[ \t]*)(?:\n|$))*)", re.MULTILINE)
_ROLE = re.compile(r":math:`([^`]+)`")
_SECTION = re.compile(r"^(Parameters|Returns|Raises)\n-+$", re.MULTILINE)


def refreshed(page: str) -> str:
    """Return a page with its blocks made anew. Raises KeyError on an unknown kind of block."""

    def block(match: re.Match[str]) -> str:
        begin, kind, of, end = match.groups()
        content = KINDS[kind](of) if of else KINDS[kind]()
        return f"{begin}\n{content.strip()}\n\n{end}"

    return _BLOCK.sub(block, page)


def wrong_values(page: str) -> Iterator[str]:
    """Yield each value after a name that is not the code's, with what the code has."""
    known = thresholds()
    for name, quoted in _VALUE.findall(_BLOCK.sub("", page)):
        path, _, last = name.rpartition(".")
        of_module = path and last.isupper()
        value = constant(f"qlvbayes.{path}", last) if of_module else known.get(name)
        if value is None or not isclose(value, float(quoted)):
            yield f"{name} = {quoted}, and {value} in the code"


def constant(module: str, name: str) -> Any:
    """Return a module's constant, by name."""
    return getattr(importlib.import_module(module), name)


def thresholds() -> dict[str, Any]:
    """Return the settings of the diagnosis, those of a part as ``breadth.beam``."""
    from qlvbayes.diagnosis.settings import DiagnosisSettings

    return _flat(dataclasses.asdict(DiagnosisSettings()))


def _flat(settings: dict[str, Any]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, value in settings.items():
        inner = _flat(value) if isinstance(value, dict) else {}
        found |= {f"{name}.{key}": own for key, own in inner.items()} or {name: value}
    return found


def settings() -> str:
    """Return the table of all settings of the diagnosis."""
    return _table(("name", "value"), [(f"`{k}`", str(v)) for k, v in thresholds().items()])


def doc(path: str) -> str:
    """Return a docstring of ``module`` or ``module:function`` after its first line, in Markdown."""
    module, _, name = path.partition(":")
    found = importlib.import_module(f"qlvbayes.{module}")
    text = inspect.getdoc(getattr(found, name) if name else found) or ""
    text = _SECTION.split(text.partition("\n")[2])[0]
    return markdown(text.strip())


def markdown(text: str) -> str:
    """Return a docstring's text in Markdown, with its formulas between dollars."""

    def dollars(match: re.Match[str]) -> str:
        first, _, rest = match[1].partition("\n")
        formula = f"{first}\n{textwrap.dedent(rest)}".strip()
        return f"$$\n{formula}\n$$\n\n"

    plain = _ROLE.sub(lambda role: f"${' '.join(role[1].split())}$", text)
    return _MATH.sub(dollars, plain).replace("``", "`")


def commands() -> str:
    """Return every command as the terminal's help shows it."""
    import typer

    from qlvbayes.cli.main import application

    group: Any = typer.main.get_command(application())
    shown = [_command(name, command) for name, command in group.commands.items()]
    return "\n\n".join((*shown, _settings_of_commands(group.commands)))


def _settings_of_commands(commands: Collection[str]) -> str:
    """Return the settings that commands share: keys of a file, and options."""
    from qlvbayes.cli.settings import KEYS, PARTS

    parts = {name: own for name, own in PARTS.items() if name in commands}
    used = {part: ", ".join(name for name, own in parts.items() if part in own) for part in (
        dict.fromkeys(key.part for key in KEYS.values())
    )}  # fmt: skip
    rows = [(f"`--{name}`", _plain(key.what), used[key.part]) for name, key in KEYS.items()]
    return "\n\n".join(("## Settings", _table(("", "what it is", "used by"), rows)))


def _command(name: str, command: Any) -> str:
    by_kind: dict[str, list[Any]] = {"argument": [], "option": []}
    for parameter in command.params:
        by_kind[parameter.param_type_name].append(parameter)
    names = [parameter.name.upper() for parameter in by_kind["argument"]]
    parts = [f"## {' '.join(('qlvbayes', name, *names))}", _plain(command.help or "")]
    rows = [_option(one) for parameters in by_kind.values() for one in parameters]
    if rows:
        parts.append(_table(("", "what it is", "default"), rows))
    return "\n\n".join(parts)


def _option(parameter: Any) -> tuple[str, str, str]:
    words = " ".join(_plain(parameter.help or "").split())
    if parameter.param_type_name == "argument":
        return f"`{parameter.name.upper()}`", words, ""
    written = ", ".join((*parameter.opts, *parameter.secondary_opts))
    default = parameter.default
    plain = isinstance(default, (str, int, float, Path)) and not isinstance(default, bool)
    shown = "required" if parameter.required else str(default) if plain else ""
    return f"`{written}`", words, shown


def _plain(text: str) -> str:
    """Return a help in which ``<pad>`` is no tag of HTML."""
    return inspect.cleandoc(text).replace("<", "&lt;")


def effect_table() -> str:
    """Return a row for each effect and form: its law, what shows it, where it can be stepped."""
    from qlvbayes.model.stepping import steps

    rows = []
    for kind in _effects():
        way = "yes" if steps(kind) else "no"
        back = "yes" if steps(kind) and kind.inverts else "no"
        name = f"{'… ' if kind.generalises else ''}[`{kind.name}`](#{kind.name})"
        rows.append((name, f"`{kind.law}`", kind.seen, way, back))
    names = ("effect", "law", "what you would see", "steps", "displacement from force")
    return _table(names, rows)


def effects() -> str:
    """Return a section for each effect and form."""
    return "\n\n".join(_effect(kind) for kind in _effects())


def _effects() -> list[Any]:
    from qlvbayes.effects.catalogue import by_family

    return [kind for members in by_family().values() for kind in members]


def _effect(kind: Any) -> str:
    from qlvbayes.io.units import PAD
    from qlvbayes.model.stepping import steps

    remarks = [f"*What you would see:* {kind.seen}."]
    if kind.generalises:
        at = ", ".join(f"`{name}` = {value}" for name, value in kind.reduces.items())
        family = kind.generalises
        remarks.append(f"A form of [`{family}`](#{family}), which it is at {at}.")
    elif kind.outside:
        remarks.append("It names no effect: it represents something unmodelled.")
    if not steps(kind):
        remarks.append(f"It cannot be stepped: {kind.not_stepped}.")
    elif not kind.inverts:
        remarks.append(f"No displacement follows from a force: {kind.not_inverted}.")
    rows = [
        (
            f"`{kind.name}.{name}`",
            kind.meanings[name].replace("``", "`"),
            PAD.of(word),
            str(kind.null.get(name, "")),
        )
        for name, word in kind.units.items()
    ]
    return "\n\n".join(
        (
            f"{'###' if kind.generalises else '##'} {kind.name}",
            markdown(inspect.getdoc(kind) or ""),
            "\n\n".join(remarks),
            _table(("constant", "what it is", "unit", "vanishes at"), rows),
            f"Acts on: {kind.level.name.lower()}{', also off the pad' * kind.off_pad}. "
            f"Reference: {kind.reference}.",
        )
    )


def laws() -> str:
    """Return the elastic laws and the relaxations, each a row."""
    from qlvbayes.io.catalogue import ELASTIC, RELAXATION, loaded
    from qlvbayes.io.units import PAD

    rows = []
    for option, listed in (("--elastic", ELASTIC), ("--relaxation", RELAXATION)):
        for name, kind in loaded(listed).items():
            constants = ", ".join(
                f"`{c}`" + (f" ({unit})" if (unit := PAD.of(word)) != "1" else "")
                for c, word in kind.units.items()
            )
            rows.append((f"`{option} {name}`", f"`{kind.law}`", constants, kind.reference))
    return _table(("option", "law", "constants", "source"), rows)


def figures() -> str:
    """Return the figures in the folder of each pad, the command that leaves each, what it shows."""
    from qlvbayes.plots.catalogue import FIGURES

    rows = [
        (f"`{one.name}`", f"`{one.command}`", one.shows.replace("{of}", "the pad"))
        for one in FIGURES
        if one.takes is not None
    ]
    return _table(("figure", "command", "what it shows"), rows)


def sources() -> str:
    """Return the source of each effect, in alphabetical order."""
    kinds = sorted(_effects(), key=lambda kind: str(kind.name))
    return "\n".join(f"- `{kind.name}`: {kind.reference}" for kind in kinds)


def _table(names: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    """Return a table of Markdown, whose cells may hold bars."""
    lines = [names, ("---",) * len(names), *rows]
    return "\n".join(
        "| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines
    )


def keys(path: str) -> str:
    """Return the keys of a file of results: of its record, as ``fitting.summary.FitSummary``."""
    module, _, name = path.rpartition(".")
    kind = getattr(importlib.import_module(f"qlvbayes.{module}"), name)
    return _table(("key", "holds", "what it is"), list(record(kind)))


KINDS: dict[str, Any] = {
    "commands": commands,
    "doc": doc,
    "effect_table": effect_table,
    "effects": effects,
    "figures": figures,
    "keys": keys,
    "laws": laws,
    "settings": settings,
    "sources": sources,
}


def main() -> int:
    """Refresh every page; say which values that stand in the text are wrong."""
    wrong = []
    for page in sorted(DOCS.glob("*.md")):
        text = page.read_text(encoding="utf-8")
        new = refreshed(text)
        if new != text:
            page.write_text(new, encoding="utf-8")
            print(f"written anew: {page}")
        wrong += [f"{page}: {words}" for words in wrong_values(new)]
    print("\n".join(wrong), file=sys.stderr, end="\n" if wrong else "")
    return bool(wrong)


if __name__ == "__main__":
    sys.exit(main())
