"""Write the verdict, the models and the constants as text for figures."""

from __future__ import annotations

import re
from collections.abc import Sequence
from textwrap import fill

from qlvbayes.diagnosis import phrases
from qlvbayes.diagnosis.result import DiagnosisResult
from qlvbayes.io.wording import plain
from qlvbayes.plots.style import quantity, shortened

_INDEXED = re.compile(r"([a-z])\[(\d+)\]")

_LINE, _LINE_TIGHT = 80, 40  # characters across two columns of a journal, and across one


def model_lines(effects: Sequence[str], laws: Sequence[str], most: int) -> str:
    """Return a model's name in lines of ``most`` characters at most, where words allow it."""
    words = ["by " + "\nand ".join(broken(name, most) for name in laws)] if laws else []
    words += ["with " + "\n+ ".join(broken(name, most) for name in effects)] if effects else []
    return "\n".join(words) or phrases.model_name(effects)


def heading(diagnosis: DiagnosisResult, *, tight: bool = False) -> str:
    """Return the pad and its verdict, in several lines if needed; ``tight`` is for one column."""
    line = _LINE_TIGHT if tight else _LINE
    pad = phrases.pad_title(shortened(diagnosis.pad, line // 2))
    return fill(f"{pad}: {phrases.heading(diagnosis)}", line)


def parameter_label(name: str, unit: str = "1") -> str:
    """Return a constant as an axis shows it, its index low."""
    match = _INDEXED.fullmatch(name)
    if match:
        text = rf"$\mathit{{{match[1]}}}_{{{match[2]}}}$"
    else:
        text = rf"$\mathit{{{name}}}$" if len(name) == 1 else name.replace(".", "\n")
    return quantity(text, unit)


def parameter_lines(name: str, unit: str, most: int) -> str:
    """Return a constant and its unit in lines of ``most`` characters at most."""
    *effect, constant = parameter_label(name).split("\n")
    words = [*_words("".join(effect)), constant]
    return "\n".join(_lines(words if unit == "1" else [*words, f"({unit})"], most))


def broken(name: str, most: int) -> str:
    """Divide a long name at its underscores, for a narrow space."""
    return "\n".join(_lines(_words(name), most))


def _words(name: str) -> list[str]:
    return name.replace("_", "_ ").split()


def _lines(words: Sequence[str], most: int) -> list[str]:
    """Fill lines with words; no space follows an underscore."""
    lines = [words[0]]
    for word in words[1:]:
        longer = lines[-1] + " " * (not lines[-1].endswith("_")) + word
        if _seen(longer) > most:
            lines.append(word)
        else:
            lines[-1] = longer
    return lines


def _seen(text: str) -> int:
    """Return how many characters of a text with formulas are visible."""
    return len(re.sub(r"\$\\mathit\{(\w)\}(?:_\{(\d+)\})?\$", r"\1\2", text))


def three(value: float) -> str:
    """Return three digits, zeros at the end too: '0.0100'."""
    text = f"{value:#.3g}".rstrip(".")
    return plain(value) if "e+" in text else text
