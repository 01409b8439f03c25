"""The noise of the load cell, measured at rest and without any model of the material."""

from qlvbayes.preprocess.noisefloor.floor import NoiseFloor
from qlvbayes.preprocess.noisefloor.measuring import measure

__all__ = ["NoiseFloor", "measure"]
