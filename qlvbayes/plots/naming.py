"""Write the verdict, the models and the constants as text for figures."""

from __future__ import annotations

import re
from collections.abc import Sequence
from textwrap import fill

from qlvbayes.diagnosis.result import DiagnosisResult
from qlvbayes.io.wording import plain
from qlvbayes.plots.style import quantity, shortened

_INDEXED = re.compile(r"([a-z])\[(\d+)\]")

_LINE, _LINE_TIGHT = 80, 40  # characters across two columns of a journal, and across one


def model_name(effects: Sequence[str], laws: Sequence[str] = ()) -> str:
    """Return 'plain model', 'with viscous_drag + friction', 'by hertz', 'by hertz with friction'.

    ``laws`` are base laws that are not the chosen ones.
    """
    words = [_by(laws)] if laws else []
    words += [f"with {' + '.join(effects)}"] if effects else []
    return " ".join(words) or "plain model"


def model_lines(effects: Sequence[str], laws: Sequence[str], most: int) -> str:
    """Return the same in lines of ``most`` characters at most, where words allow it."""
    words = ["by " + "\nand ".join(broken(name, most) for name in laws)] if laws else []
    words += ["with " + "\n+ ".join(broken(name, most) for name in effects)] if effects else []
    return "\n".join(words) or model_name(effects)


def heading(diagnosis: DiagnosisResult, *, tight: bool = False) -> str:
    """Return the pad and its verdict, in several lines if needed; ``tight`` is for one column."""
    line = _LINE_TIGHT if tight else _LINE
    return fill(f"pad {shortened(diagnosis.pad, line // 2)}: {_verdict(diagnosis)}", line)


def _verdict(diagnosis: DiagnosisResult) -> str:
    if diagnosis.verdict == "adequate":
        return f"nothing missing that these tests show{_on_laws(diagnosis)}"
    if diagnosis.verdict == "unexplained":
        tried = diagnosis.tried
        return f"unexplained, also {model_name(tried)}" if tried else "unexplained by any effect"
    if diagnosis.verdict == "ambiguous":
        certain = [name for name in diagnosis.effects if name not in diagnosis.group]
        return "missing " + " + ".join([*certain, f"one of {', '.join(diagnosis.group)}"])
    rest = ", and something unlisted" if diagnosis.verdict == "partly_explained" else ""
    return f"missing {' + '.join(diagnosis.effects)}{rest}{_on_laws(diagnosis)}"


def _on_laws(diagnosis: DiagnosisResult) -> str:
    """Return the base laws, where they are not the chosen ones."""
    return f", {_by(diagnosis.changed)}" if diagnosis.changed else ""


def _by(laws: Sequence[str]) -> str:
    return f"by {' and '.join(laws)}"


def parameter_label(name: str, unit: str = "1") -> str:
    """Return a constant as an axis shows it, its index low.

    An effect's constant takes two lines.
    """
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
