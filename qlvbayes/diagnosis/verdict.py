"""The five verdicts that a diagnosis may come to."""

from __future__ import annotations

from enum import StrEnum


class Verdict(StrEnum):
    """The verdict on one pad; the values are those of ``verdict`` in ``diagnosis.json``."""

    ADEQUATE = "adequate"
    """No effect is needed, and no phase of any test shows structure that matters."""
    MISSING_EFFECT = "missing_effect"
    """The named effects are in the model and leave no structure that matters."""
    AMBIGUOUS = "ambiguous"
    """Something is missing, and a group of effects explains it equally well."""
    PARTLY_EXPLAINED = "partly_explained"
    """The named effects are in the model, and something unmodelled is there too."""
    UNEXPLAINED = "unexplained"
    """Structure remains, and no effect can be named."""

    @property
    def has_unmodelled(self) -> bool:
        """True if the verdict says that something is there which no candidate effect is."""
        return self in (Verdict.PARTLY_EXPLAINED, Verdict.UNEXPLAINED)
