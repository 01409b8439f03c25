"""Whether an effect's constants are recovered from simulated tests, at the right rate."""
