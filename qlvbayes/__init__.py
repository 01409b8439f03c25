"""Constants of soft pads from force-displacement tests, with honest uncertainty."""

__version__ = "0.1.0"
