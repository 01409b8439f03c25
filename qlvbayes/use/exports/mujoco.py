"""MuJoCo: a contact and a slide joint's polynomial spring without memory, a plugin with it."""

from __future__ import annotations

from qlvbayes.use.exports.c_header import c_files, layered
from qlvbayes.use.exports.card import card, in_comment, template
from qlvbayes.use.exports.contact import LEAST_IMPEDANCE, Floats, soft_constraint
from qlvbayes.use.exports.errors import error_files
from qlvbayes.use.exports.language import C
from qlvbayes.use.exports.pad import ExportedPad
from qlvbayes.use.exports.reduction import SI, Pressing, closest, fitted, pressing
from qlvbayes.use.exports.target import AbstractTarget, Geometry

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
            "p": pad.identifier,
            "P": pad.identifier.upper(),
            "stiffness": [k0, k1, k2],
            "damping": c,
            "solref": solref,
            "solimp": solimp,
            "mass": _MASS,
            "depth": float(max(x)),
            "length": SI.factor_to(pad.units, "displacement"),
            "newton": pad.units.factor_to(SI, "force"),
            **layered(pad, C(pad.identifier)),
        }

        def filled(file: str, *extra: str) -> bytes:
            text = in_comment(card(pad, type(self), extra))
            return template(file, card=text, **values).encode()

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
