"""Fill pages with values from the code; a name that the code no longer has stops the build."""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import re
import textwrap
from typing import Any

import jinja2
from commands import commands
from public import figures, public_names, section

from qlvbayes.plots.catalogue import figures_of

_MATH = re.compile(r"^\.\. math::[ \t]*(.*\n?(?:(?:[ \t]+\S.*|[ \t]*)(?:\n|$))*)", re.MULTILINE)


def filled(template: str) -> str:
    """Fill a template with the code's values. Raises jinja2.UndefinedError on an unknown name."""
    environment = jinja2.Environment(
        undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    return environment.from_string(template).render(context())


def context() -> dict[str, Any]:
    """Return every name that a page may use."""
    from qlvbayes.diagnosis.settings import DiagnosisSettings
    from qlvbayes.effects.catalogue import EFFECTS, FORMS, OUTSIDE, by_family
    from qlvbayes.io.units import PAD

    return {
        "settings": DiagnosisSettings(),
        "thresholds": _flat(dataclasses.asdict(DiagnosisSettings())),
        "constant": constant,
        "doc": docstring,
        "effects": EFFECTS,
        "forms": FORMS,
        "outside": OUTSIDE,
        "families": by_family,
        "unit": PAD.of,
        "doc_of": inspect.getdoc,
        "lower_levels": levels,
        "commands": commands,
        "public": public_names,
        "section": section,
        "figures": figures,
        "pad_figures": pad_figures,
    }


def pad_figures(command: str) -> str:
    """Return the figures that a command leaves in the folder of each pad, as code."""
    return ", ".join(f"`{one.name}`" for one in figures_of(command))


def _flat(settings: dict[str, Any]) -> dict[str, Any]:
    """Return the settings with the fields of a part by themselves, as ``breadth.beam``."""
    found: dict[str, Any] = {}
    for name, value in settings.items():
        inner = _flat(value) if isinstance(value, dict) else {}
        found |= {f"{name}.{key}": own for key, own in inner.items()} or {name: value}
    return found


def constant(module: str, name: str) -> Any:
    """Return a module's constant, by name."""
    return getattr(importlib.import_module(module), name)


def docstring(path: str) -> str:
    """Return a docstring of ``module`` or ``module:function`` after its first line, in Markdown."""
    module, _, name = path.partition(":")
    found = importlib.import_module(module)
    text = inspect.getdoc(getattr(found, name) if name else found) or ""
    return in_dollars(text.partition("\n")[2].strip())


def in_dollars(text: str) -> str:
    """Put the ``.. math::`` blocks of a text between double dollars."""

    def dollars(match: re.Match[str]) -> str:
        first, _, rest = match[1].partition("\n")
        formula = f"{first}\n{textwrap.dedent(rest)}".strip()
        return f"$$\n{formula}\n$$\n\n"

    return _MATH.sub(dollars, text)


def levels() -> list[str]:
    """Return what effects act on, from the inside out."""
    from qlvbayes.effects.effect import Level

    return [level.name.lower() for level in Level]
