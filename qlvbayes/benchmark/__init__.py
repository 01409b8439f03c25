"""Blind studies: simulated pads with something hidden, and how often the diagnosis finds it."""
