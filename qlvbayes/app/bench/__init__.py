"""Lay a model over the measurements by hand: sliders, signatures, refits, held-out errors."""
