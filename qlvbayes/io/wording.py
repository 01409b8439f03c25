"""Words in a row, as a sentence has them."""

from __future__ import annotations

from math import floor, log10


def plain(value: float, digits: int = 3) -> str:
    """Significant digits without a power of ten from 0.0001 to 10 million: '25100', '0.0123'."""
    text = f"{value:.{digits}g}"
    if "e" not in text or not 1.0 <= abs(value) < 1e7:
        return text
    return f"{round(value, digits - 1 - floor(log10(abs(value)))):.0f}"


def to_noise(value: float, noise: float, sign: str = "") -> str:
    """To a hundredth of the noise's first digit; '2.3e-08' where that takes too many decimals."""
    places = max(0, 2 - floor(log10(noise))) if noise > 0.0 else 4
    text = f"{value:{sign}.{places}f}" if places <= 6 else f"{value:{sign}.2g}"
    return text.replace("-", sign, 1) if float(text) == 0.0 else text


def percent(share: float) -> str:
    """A probability in two digits, three near certainty, and never certainty itself."""
    if share > 0.999:
        return "> 99.9 %"
    return "< 0.1 %" if share < 0.001 else f"{100.0 * share:.{3 if share > 0.98 else 2}g} %"


def joined(words: list[str], last: str = "and") -> str:
    """'a, b and c'."""
    return f"{', '.join(words[:-1])} {last} {words[-1]}" if len(words) > 1 else "".join(words)
