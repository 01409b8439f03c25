"""Which physical effect a model lacks: one posterior over hypotheses, one search, one decision."""
