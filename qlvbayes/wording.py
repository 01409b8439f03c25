"""Words in a row, as a sentence has them."""

from __future__ import annotations


def joined(words: list[str], last: str = "and") -> str:
    """'a, b and c'."""
    return f"{', '.join(words[:-1])} {last} {words[-1]}" if len(words) > 1 else "".join(words)
