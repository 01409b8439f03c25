"""Blind studies: simulated pads with known hidden effects, and how often a diagnosis is right."""
