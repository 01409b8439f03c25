"""Numbers in columns of fixed width, with as many digits as there is room for."""

from __future__ import annotations

from qlvbayes.io.checks import InputError

_DIGITS = 17  # after which a double is itself again


def column(value: float, width: int, exponent: str = "e") -> str:
    """Return a number right-aligned in its column; ``exponent``: empty for solvers that read 1.5-3.

    Raises InputError where not one digit has room.
    """
    for digits in range(_DIGITS, 0, -1):
        shortest = repr(value) if digits == _DIGITS else f"{value:.{digits}g}"
        mantissa, _, power = f"{value:#.{digits - 1}e}".partition("e")
        sign = "" if exponent else "+" if int(power) >= 0 else ""
        short = f"{mantissa.rstrip('0')}{exponent}{sign}{int(power)}"
        whole = shortest if "." in shortest else f"{shortest}."
        for text in (short,) if "e" in shortest else (whole, whole.lstrip("0"), short):
            if text != "." and len(text) <= width:
                return text.rjust(width)
    raise InputError(f"{value:g} has no room in {width} columns", remedy="use --to json")
