"""Simulators' own contacts, which know the depth and the speed of the moment: MuJoCo and Drake."""

from __future__ import annotations

import json
from collections.abc import Mapping

import numpy as np

from qlvbayes.io.wording import visible
from qlvbayes.motion.phases import NAMES
from qlvbayes.use.exports.card import ONE_DRAW, card, in_comment, template
from qlvbayes.use.exports.code import c_files, values_of
from qlvbayes.use.exports.language import in_c
from qlvbayes.use.exports.pad import ExportedPad
from qlvbayes.use.exports.reduction import SI, Floats, Pressing, closest, fitted, pressing
from qlvbayes.use.exports.target import AbstractTarget, Geometry

LEAST_IMPEDANCE = 1e-4
"""MuJoCo's own bound on the impedance (mjMINIMP)."""


def hunt_crossley(depth: Floats, speed: Floats, stiffness: float, dissipation: float) -> Floats:
    r"""Return the force of Drake's point contact, of a soft body with a hard one.

    .. math:: F = k\, x\, (1 + d\, v)_+

    stiffness k (N/m), dissipation d (s/m). Of a soft layer that a flat face presses, Drake's
    hydroelastic contact is the same with k = E_h A/H: modulus E_h (Pa), area A (m2), depth of the
    foundation H (m; of a box half its thickness). Drake, "Modeling compliant contact"; Hunt &
    Crossley 1975, doi:10.1115/1.3423596.
    """
    return stiffness * np.maximum(depth, 0.0) * np.maximum(1.0 + dissipation * speed, 0.0)


def impedance(
    depth: Floats, least: float, most: float, width: float, midpoint: float, power: float
) -> Floats:
    r"""Return MuJoCo's impedance d(x): a power from either end of a sigmoid over the width."""
    s = np.clip(np.abs(depth) / width, 0.0, 1.0)
    rising = s**power / midpoint ** (power - 1.0)
    falling = 1.0 - (1.0 - s) ** power / (1.0 - midpoint) ** (power - 1.0)
    return least + (most - least) * np.where(s <= midpoint, rising, falling)


def soft_constraint(
    depth: Floats,
    speed: Floats,
    stiffness: float,
    damping: float,
    solimp: tuple[float, float, float, float, float],
    *,
    mass: float = 1.0,
    acceleration: Floats | float = 0.0,
) -> Floats:
    r"""Return the normal force of MuJoCo's contact, ``solref`` as (-stiffness, -damping)."""
    d, most = impedance(depth, *solimp), solimp[1]
    pull = acceleration + damping / most * speed + stiffness * d / most**2 * depth
    return np.where(depth > 0.0, np.maximum(mass * d / (1.0 - d) * pull, 0.0), 0.0)


_MODEL = "with memory"


def error_files(
    pad: ExportedPad,
    target: type[AbstractTarget],
    pressed: Pressing,
    forces: Mapping[str, Floats],
    constants: Mapping[str, float | list[float]],
) -> dict[str, bytes]:
    """Return the content of ``pad_B_error.txt`` and ``pad_B_error.json``."""
    every = {**forces, _MODEL: pressed.force}
    errors = {name: pressed.errors(force) for name, force in every.items()}
    whole = {name: pressed.miss(force) for name, force in every.items()}
    content = {
        "schema": 1,
        "pad": pad.pad,
        "target": target.name,
        "date": pad.date,
        "against": "model" if pressed.absent else "measured",
        "why_not_measured": pressed.absent or None,
        "numbers": dict(constants),
        "whole": {
            name: {"rms": x.rms, "largest": x.largest, "holds_rms": x.hold}
            for name, x in whole.items()
        },
        "cells": [
            {
                "test": cell.test,
                "role": cell.role or None,
                "phase": cell.phase,
                "peak_N": float(peak),
                "rms_over_peak": {name: float(values[i]) for name, values in errors.items()},
            }
            for i, (cell, peak) in enumerate(zip(pressed.cells, pressed.peaks, strict=True))
        ],
    }
    table = _table(pressed, errors, {name: miss.rms for name, miss in whole.items()})
    lines = [*card(pad, target), "", *map(visible, _words(pressed)), "", *map(visible, table)]
    text = "\n".join(lines)
    name = pad.identifier
    return {
        f"{name}_error.txt": (text + "\n").encode(),
        f"{name}_error.json": (json.dumps(content, allow_nan=False, indent=1) + "\n").encode(),
    }


def _table(
    pressed: Pressing, errors: Mapping[str, Floats], whole: Mapping[str, float]
) -> list[str]:
    """Return lines of the errors by test and phase, and over all of them."""
    wide = max(len(cell.test) for cell in pressed.cells)
    columns = {name: max(len(name), 7) for name in errors}
    head = f"{'test':{wide}}  {'role':8}  {'phase':9}  {'peak N':>8}"
    lines = [head + "".join(f"  {name:>{size}}" for name, size in columns.items())]
    for i, (cell, peak) in enumerate(zip(pressed.cells, pressed.peaks, strict=True)):
        row = f"{cell.test:{wide}}  {cell.role:8}  {NAMES[cell.phase]:9}  {peak:8.4g}"
        lines.append(row + "".join(f"  {errors[k][i]:>{n}.2%}" for k, n in columns.items()))
    row = f"{'all':{wide}}  {'':8}  {'':9}  {'':8}"
    return [*lines, row + "".join(f"  {whole[k]:>{n}.2%}" for k, n in columns.items())]


def _words(pressed: Pressing) -> list[str]:
    """Return what the table is of, and what follows from it."""
    if pressed.absent:
        return [
            f"Set against the pad's own model, not against measured forces: {pressed.absent}.",
            "Root mean square of the contact's force less the model's, over the largest force:",
        ]
    return [
        "Root mean square of the force less the measured one, over the test's largest force.",
        "The last column is the pad's model, as --to c, fmu, mujoco (the plugin) and matlab "
        "represent it; where it is much smaller than the others, no contact without memory is "
        "enough.",
    ]


_MM = 1e-3  # of a m


class Drake(AbstractTarget):
    r"""Stiffness and Hunt-Crossley dissipation, closest to the pad's force.

    .. math:: F = k\, x\, (1 + d\, \dot x)_+

    x: depth (m); k (N/m), d (s/m), neither below zero; in the mean square along the pad's tests.
    Two bodies in contact are in series: k is that of the pair if the other is hard. With a
    specimen's shape also the hydroelastic modulus of a box or cylinder of its height that a hard
    face of its area presses, k (height/2)/area, which has the same force.
    Hunt & Crossley 1975, doi:10.1115/1.3423596.
    """

    name = "drake"
    without_steps = "only as far as one stiffness and one dissipation can represent it"
    what = "proximity properties: stiffness in N/m, dissipation in s/m, in SDFormat; their error"
    cannot = (
        "relaxation: no memory, one stiffness for ramp and hold",
        "stiffening with depth",
        ONE_DRAW,
    )

    def files(self, pad: ExportedPad, specimen: Geometry | None) -> dict[str, bytes]:
        """Return the content of ``pad_B.sdf``, properties of a collision, and of its errors."""
        pressed = pressing(pad)
        spring = pressed.depth
        k, kd = fitted([spring, spring * pressed.speed], pressed)
        start = [k, kd / k] if k > 0.0 else [*fitted([spring], pressed), 0.0]
        stiffness, dissipation = closest(hunt_crossley, pressed, start)
        force = hunt_crossley(pressed.depth, pressed.speed, stiffness, dissipation)
        constants = {"stiffness (N/m)": stiffness, "dissipation (s/m)": dissipation}
        solid = {}
        if specimen is not None:
            foundation, area = 0.5 * specimen.height * _MM, specimen.area * _MM**2
            solid = {"modulus": stiffness * foundation / area, "foundation": foundation}
            constants["hydroelastic modulus (Pa)"] = solid["modulus"]
        text = template(
            "pad.sdf.j2",
            card=in_comment(card(pad, type(self), [f"so this {pressed.miss(force)}"])),
            name=pad.identifier,
            stiffness=stiffness,
            dissipation=dissipation,
            solid=solid,
        )
        return {
            f"{pad.identifier}.sdf": text.encode(),
            **error_files(pad, type(self), pressed, {"point contact": force}, constants),
        }


_MASS = 0.1  # kg, of the body in the files; both constants of solref go as one over it
_IMPEDANCE = 0.1  # the largest: the mass that a contact adds is then a ninth of the body's
_MIDPOINTS = (0.05, 0.95)  # of solimp's sigmoid: beyond them it is a step
_POWERS = (1.0, 6.0)


class MuJoCo(AbstractTarget):
    r"""A contact's ``solref`` and ``solimp``, a joint's polynomial stiffness, and a plugin.

    .. math:: F = k_0 x + k_1 x^2 + k_2 x^3 + c\, \dot x

    is the joint's, x: depth (m); none below zero; in the mean square along the pad's tests, as is
    the contact (`contact.soft_constraint`), of a free body of 0.1 kg. Needs a MuJoCo that knows
    polynomial springs. The plugin, in C, steps the whole model: a passive force on one joint, its
    state part of ``mjData``, so that it is saved, copied and reset with it.
    """

    name = "mujoco"
    what = "a contact, a joint with polynomial stiffness (SI units), and a plugin with memory in C"
    steps = True
    cannot = (
        "in contact and polynomial: relaxation, what effects remember, the posterior (the plugin "
        "has all three); in the polynomial: loss of contact",
    )

    def files(self, pad: ExportedPad, specimen: Geometry | None) -> dict[str, bytes]:
        """Return the content of the joint, the contact, the plugin, its header and their errors."""
        pressed = pressing(pad)
        x, v = pressed.depth, pressed.speed
        k0, k1, k2, c = map(float, fitted([x, x**2, x**3, v], pressed))
        joint = k0 * x + k1 * x**2 + k2 * x**3 + c * v
        solref, solimp, touched = _contact(pressed)
        values = {
            **values_of(pad, type(self), in_c(pad.identifier)),
            "stiffness": [k0, k1, k2],
            "damping": c,
            "solref": solref,
            "solimp": solimp,
            "mass": _MASS,
            "depth": float(max(x)),
            "length": SI.factor_to(pad.units, "displacement"),
            "newton": pad.units.factor_to(SI, "force"),
        }

        def filled(file: str, *extra: str) -> bytes:
            text = in_comment(card(pad, type(self), extra))
            return template(file, **values | {"card": text}).encode()

        constants: dict[str, float | list[float]] = {
            f"solref of {_MASS:g} kg (1/s2, 1/s)": solref,
            "solimp (1, 1, m, 1, 1)": solimp,
            "joint stiffness (N/m, N/m2, N/m3)": [k0, k1, k2],
            "joint damping (N s/m)": c,
        }
        forces = {"contact": touched, "joint": joint}
        contact = f"so the contact {pressed.miss(touched)}"
        polynomial = f"so the polynomial {pressed.miss(joint)}"
        return {
            f"{pad.identifier}.xml": filled("mujoco.xml.j2", polynomial),
            f"{pad.identifier}_contact.xml": filled("mujoco_contact.xml.j2", contact),
            f"{pad.identifier}_plugin.c": filled("mujoco_plugin.c.j2", polynomial, contact),
            **c_files(pad, type(self)),
            **error_files(pad, type(self), pressed, forces, constants),
        }


def _contact(pressed: Pressing) -> tuple[list[float], list[float], Floats]:
    """Return solref, solimp and the force (n,) of the contact that is closest, at steady speed."""
    width = float(max(pressed.depth))

    def law(
        depth: Floats, speed: Floats, s: float, b: float, least: float, middle: float, power: float
    ) -> Floats:
        solimp = (least, _IMPEDANCE, width, middle, power)
        return soft_constraint(depth, speed, s, b, solimp, mass=_MASS)

    # at one impedance throughout the contact is a spring and a damper
    spring, damper = fitted([pressed.depth, pressed.speed], pressed) * (1.0 - _IMPEDANCE) / _MASS
    parameters = closest(
        law,
        pressed,
        [spring, damper, 0.5 * _IMPEDANCE, 0.5, 2.0],
        [0.0, 0.0, LEAST_IMPEDANCE, _MIDPOINTS[0], _POWERS[0]],
        [float("inf"), float("inf"), _IMPEDANCE, _MIDPOINTS[1], _POWERS[1]],
    )
    s, b, least, middle, power = parameters
    force = law(pressed.depth, pressed.speed, *parameters)
    return [-s, -b], [least, _IMPEDANCE, width, middle, power], force
