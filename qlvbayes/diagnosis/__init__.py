"""Which physical effect a model lacks: screen, rank, confirm, and say how sure."""
