"""Count how often an effect's constants are recovered from simulated tests."""

from recovery.rate import Recovery, recovery_rate

__all__ = [
    "Recovery",
    "recovery_rate",
]
