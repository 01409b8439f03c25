"""A diagnosis and its models in the words of figure titles."""

from __future__ import annotations

import re
from collections.abc import Sequence
from textwrap import fill

from qlvbayes.diagnosis.verdict import Diagnosis
from qlvbayes.plots.style import quantity, shortened

_INDEXED = re.compile(r"([a-z])\[(\d+)\]")

_LINE, _LINE_TIGHT = 80, 40  # characters across two columns of a journal, and across one


def model_name(effects: Sequence[str]) -> str:
    """'plain model' or 'with viscous_drag + friction'."""
    return f"with {' + '.join(effects)}" if effects else "plain model"


def heading(diagnosis: Diagnosis, *, tight: bool = False) -> str:
    """The pad and its verdict, in as many lines as it takes; tight: of one column."""
    line = _LINE_TIGHT if tight else _LINE
    return fill(f"pad {shortened(diagnosis.pad, line // 2)}: {_found(diagnosis)}", line)


def _found(diagnosis: Diagnosis) -> str:
    if diagnosis.verdict == "adequate":
        return "nothing missing that these tests show"
    if diagnosis.verdict == "unexplained":
        tried = diagnosis.tried
        return f"unexplained, also {model_name(tried)}" if tried else "unexplained by any effect"
    if diagnosis.verdict == "ambiguous":
        certain = [name for name in diagnosis.effects if name not in diagnosis.group]
        return "missing " + " + ".join([*certain, f"one of {', '.join(diagnosis.group)}"])
    return f"missing {' + '.join(diagnosis.effects)}"


def parameter_label(name: str, unit: str = "1") -> str:
    """A constant as an axis shows it, indices low; that of an effect in two lines."""
    match = _INDEXED.fullmatch(name)
    if match:
        text = rf"$\mathit{{{match[1]}}}_{{{match[2]}}}$"
    else:
        text = rf"$\mathit{{{name}}}$" if len(name) == 1 else name.replace(".", "\n")
    return quantity(text, unit)


def broken(name: str, most: int) -> str:
    """Divide a long name at its underscores, to fit in a narrow place."""
    lines = [""]
    for word in name.replace("_", "_ ").split():
        if lines[-1] and len(lines[-1]) + len(word) > most:
            lines.append("")
        lines[-1] += word
    return "\n".join(lines)


def three(value: float) -> str:
    """Three digits, zeros at the end too: '0.0100'."""
    return f"{value:#.3g}".rstrip(".")
