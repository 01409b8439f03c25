"""Words in a row, as a sentence has them."""

from __future__ import annotations

from math import floor, log10


def plain(value: float, digits: int = 3) -> str:
    """Significant digits without a power of ten from 0.0001 to 10 million: '25100', '0.0123'."""
    text = f"{value:.{digits}g}"
    if "e" not in text or not 1.0 <= abs(value) < 1e7:
        return text
    return f"{round(value, digits - 1 - floor(log10(abs(value)))):.0f}"


def joined(words: list[str], last: str = "and") -> str:
    """'a, b and c'."""
    return f"{', '.join(words[:-1])} {last} {words[-1]}" if len(words) > 1 else "".join(words)
