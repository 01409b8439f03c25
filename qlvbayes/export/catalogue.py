"""Every target, in the order in which they are listed."""

from __future__ import annotations

from qlvbayes.checks import InputError
from qlvbayes.export.abaqus import Abaqus
from qlvbayes.export.ansys import Ansys
from qlvbayes.export.c_header import CHeader
from qlvbayes.export.comsol import Comsol
from qlvbayes.export.drake import Drake
from qlvbayes.export.febio import FEBio
from qlvbayes.export.fmu import Fmu
from qlvbayes.export.json_file import JsonFile
from qlvbayes.export.matlab import Matlab
from qlvbayes.export.mujoco import MuJoCo
from qlvbayes.export.target import AbstractTarget

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
