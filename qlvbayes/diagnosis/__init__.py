"""Diagnose which physical effect a model lacks: one posterior, one search, one decision."""
