"""Write a fit for other programs. One file, one target; ``io.catalogue`` lists them.

A new target is one class in one file here, under ``target.AbstractTarget``, and its line in
``TARGETS`` of ``io.catalogue``; what it writes lies in ``templates/`` where it is longer than a
few lines.
"""

from qlvbayes.use.exports.target import TARGETS, AbstractTarget, Geometry, export

__all__ = [
    "TARGETS",
    "AbstractTarget",
    "Geometry",
    "export",
]
