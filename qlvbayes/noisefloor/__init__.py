"""The noise of the load cell, measured at rest and without any model of the material."""

from qlvbayes.noisefloor.floor import NoiseFloor
from qlvbayes.noisefloor.measure import measure

__all__ = ["NoiseFloor", "measure"]
