"""What the conformance suite raises."""

from __future__ import annotations


class LawError(AssertionError):
    """A law breaks a rule; the text says which."""
