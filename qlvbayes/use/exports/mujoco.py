"""A slide joint for MuJoCo: a polynomial spring without memory, and a plugin with it."""

from __future__ import annotations

from qlvbayes.use.exports.c_header import C, c_files, layered
from qlvbayes.use.exports.card import card, in_comment, template
from qlvbayes.use.exports.pad import ExportedPad
from qlvbayes.use.exports.reduction import SI, fitted, miss, pressing
from qlvbayes.use.exports.target import AbstractTarget, Geometry


class MuJoCo(AbstractTarget):
    r"""The polynomial stiffness of a slide joint along the pressing direction, and its damping.

    .. math:: F = k_0 x + k_1 x^2 + k_2 x^3 + c\, \dot x

    x: depth (m); none below zero; in the mean square over ramps at the tested rates and holds.
    Needs a MuJoCo that knows polynomial springs. The plugin, in C, steps the whole model: a passive
    force on one joint, its state part of ``mjData``, so that it is saved, copied and reset with it.
    """

    name = "mujoco"
    what = "a joint with polynomial stiffness (SI units), and a plugin with memory in C"
    steps = True
    cannot = (
        "in the polynomial: relaxation, loss of contact, what effects remember, the posterior (the "
        "plugin has all four)",
    )

    def files(self, pad: ExportedPad, specimen: Geometry | None) -> dict[str, bytes]:
        """``pad_B.xml``, ``pad_B_plugin.c``, and the header that it calls."""
        pressed = pressing(pad)
        x = pressed.depth
        columns = [x, x**2, x**3, pressed.speed]
        k0, k1, k2, c = (float(number) for number in fitted(columns, pressed.force))
        found = miss(k0 * x + k1 * x**2 + k2 * x**3 + c * pressed.speed, pressed)
        said = card(pad, type(self), [f"so the polynomial {found}"])
        values = {
            "p": pad.identifier,
            "P": pad.identifier.upper(),
            "card": in_comment(said),
            "stiffness": [k0, k1, k2],
            "damping": c,
            "depth": float(max(x)),
            "length": SI.factor_to(pad.units, "displacement"),
            "newton": pad.units.factor_to(SI, "force"),
            **layered(pad, C(pad.identifier)),
        }
        return {
            f"{pad.identifier}.xml": template("mujoco.xml.j2", **values).encode(),
            f"{pad.identifier}_plugin.c": template("mujoco_plugin.c.j2", **values).encode(),
            **c_files(pad, type(self)),
        }
