"""A model laid over the measurements by hand: sliders, signatures, refits, errors left out."""
