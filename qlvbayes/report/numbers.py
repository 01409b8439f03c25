"""Numbers as a reader meets them."""

from __future__ import annotations

from math import floor, isfinite, log10

from qlvbayes.io import wording

DASH = "–"
NBSP = "\u00a0"  # between a number and its unit, where no line may break
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def number(value: float | None, digits: int = 3, *, zeros: bool = False) -> str:
    """Significant digits; a dash for what is not known; 1.2 × 10⁻⁷ for the very small and large.

    zeros: keep those at the end, so that errors beside each other have as many digits.
    """
    if value is None or not isfinite(value):
        return DASH
    text = (f"{value:#.{digits}g}" if zeros else f"{value:.{digits}g}").removesuffix(".")
    if "e" not in text:
        return text.replace("-", "−")
    base, _, power = text.partition("e")
    if 0 <= int(power) < 7:
        return f"{value:.0f}".replace("-", "−")
    return f"{base} × 10{str(int(power)).translate(_SUPERSCRIPT)}".replace("-", "−")


def to_sd(value: float | None, sd: float | None) -> str:
    """Return a number with two digits of its sd; four significant ones where it has none."""
    if value is None or not sd or not isfinite(sd):
        return number(value, 4)
    places = max(0, 1 - floor(log10(sd)))
    return number(value) if places > 6 else f"{value:.{places}f}".replace("-", "−")


def percent(share: float | None) -> str:
    """Return a probability, never rounded to certainty; no line breaks in it."""
    if share is None or not isfinite(share):
        return DASH
    return wording.percent(share).replace(" ", NBSP)


def with_unit(text: str, unit: str) -> str:
    """'0.34 N/mm'; without a unit where it is 1."""
    return text if unit in ("", "1") else f"{text}{NBSP}{unit}"
