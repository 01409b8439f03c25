"""Every target, in the order in which they are listed."""

from __future__ import annotations

from qlvbayes.checks import InputError
from qlvbayes.exports.abaqus import Abaqus
from qlvbayes.exports.ansys import Ansys
from qlvbayes.exports.c_header import CHeader
from qlvbayes.exports.comsol import Comsol
from qlvbayes.exports.drake import Drake
from qlvbayes.exports.febio import FEBio
from qlvbayes.exports.fmu import Fmu
from qlvbayes.exports.json_file import JsonFile
from qlvbayes.exports.matlab import Matlab
from qlvbayes.exports.mujoco import MuJoCo
from qlvbayes.exports.target import AbstractTarget

TARGETS: tuple[type[AbstractTarget], ...] = (
    CHeader,
    Fmu,
    MuJoCo,
    Drake,
    Matlab,
    Abaqus,
    Ansys,
    FEBio,
    Comsol,
    JsonFile,
)
"""Every target."""


def find(name: str) -> type[AbstractTarget]:
    """The target of that name; InputError lists the known ones otherwise."""
    for target in TARGETS:
        if target.name == name:
            return target
    known = ", ".join(target.name for target in TARGETS)
    raise InputError(f"no export to {name!r}", remedy=f"use one of {known}")
