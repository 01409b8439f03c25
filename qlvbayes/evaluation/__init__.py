"""Blind studies: simulated pads with known hidden effects, and how often the diagnosis is right."""
