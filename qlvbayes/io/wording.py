"""Write numbers and lists of words as text for messages."""

from __future__ import annotations

from math import floor, log10


def plain(value: float, digits: int = 3) -> str:
    """Return significant digits, without a power of ten from 0.0001 to 10 million.

    Examples are '25100' and '0.0123'.
    """
    text = f"{value:.{digits}g}"
    if "e" not in text or not 1.0 <= abs(value) < 1e7:
        return text
    return f"{round(value, digits - 1 - floor(log10(abs(value)))):.0f}"


def to_noise(value: float, noise: float, sign: str = "") -> str:
    """Return a number to a hundredth of the noise's first digit.

    Where that takes too many decimals it is '2.3e-08'.
    """
    decimals = max(0, 2 - floor(log10(noise))) if noise > 0.0 else 4
    text = f"{value:{sign}.{decimals}f}" if decimals <= 6 else f"{value:{sign}.2g}"
    return text.replace("-", sign, 1) if float(text) == 0.0 else text


def percent(share: float) -> str:
    """Return a probability in two digits, or three near 1; it is never written as certain."""
    if share > 0.999:
        return "> 99.9 %"
    return "< 0.1 %" if share < 0.001 else f"{100.0 * share:.{3 if share > 0.98 else 2}g} %"


def joined(words: list[str], last: str = "and") -> str:
    """Return words as 'a, b and c'."""
    return f"{', '.join(words[:-1])} {last} {words[-1]}" if len(words) > 1 else "".join(words)
