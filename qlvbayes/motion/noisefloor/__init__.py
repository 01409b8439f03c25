"""The noise of the load cell, measured at rest and without any model of the material."""

from qlvbayes.motion.noisefloor.floor import NoiseFloor
from qlvbayes.motion.noisefloor.measuring import measure

__all__ = ["NoiseFloor", "measure"]
