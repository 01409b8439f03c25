"""List every target, in the order in which they are shown."""

from __future__ import annotations

from qlvbayes.io.checks import InputError
from qlvbayes.use.exports.abaqus import Abaqus
from qlvbayes.use.exports.ansys import Ansys
from qlvbayes.use.exports.c_header import CHeader
from qlvbayes.use.exports.comsol import Comsol
from qlvbayes.use.exports.curves import ViscoelasticCurves
from qlvbayes.use.exports.drake import Drake
from qlvbayes.use.exports.febio import FEBio
from qlvbayes.use.exports.fmu import Fmu
from qlvbayes.use.exports.isaac import Isaac
from qlvbayes.use.exports.json_file import JsonFile
from qlvbayes.use.exports.ls_dyna import LSDyna
from qlvbayes.use.exports.matlab import MatlabFunction
from qlvbayes.use.exports.mujoco import MuJoCo
from qlvbayes.use.exports.nastran import Nastran
from qlvbayes.use.exports.radioss import OpenRadioss
from qlvbayes.use.exports.target import AbstractTarget

TARGETS: tuple[type[AbstractTarget], ...] = (
    CHeader,
    Fmu,
    MuJoCo,
    Drake,
    Isaac,
    MatlabFunction,
    Abaqus,
    Ansys,
    FEBio,
    Comsol,
    LSDyna,
    Nastran,
    OpenRadioss,
    ViscoelasticCurves,
    JsonFile,
)
"""Every target."""


def find(name: str) -> type[AbstractTarget]:
    """Return the target of that name, or raise InputError, which lists the known ones."""
    for target in TARGETS:
        if target.name == name:
            return target
    known = ", ".join(target.name for target in TARGETS)
    raise InputError(f"no export to {name!r}", remedy=f"use one of {known}")
