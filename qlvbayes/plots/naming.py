"""A diagnosis and its models in the words of figure titles."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import fill

from qlvbayes.diagnosis.verdict import Diagnosis
from qlvbayes.plots.style import shortened

_LINE = 80  # characters across two columns of a journal


def model_name(effects: Sequence[str]) -> str:
    """'plain model' or 'with viscous_drag + friction'."""
    return f"with {' + '.join(effects)}" if effects else "plain model"


def heading(diagnosis: Diagnosis) -> str:
    """The pad and its verdict, in as many lines as it takes."""
    return fill(f"pad {shortened(diagnosis.pad)}: {_found(diagnosis)}", _LINE)


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


def broken(name: str, most: int = 18) -> str:
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
