"""Point and hydroelastic contact for Drake, without memory."""

from __future__ import annotations

from qlvbayes.use.exports.card import ONE_DRAW, card, in_comment, template
from qlvbayes.use.exports.contact import hunt_crossley
from qlvbayes.use.exports.errors import error_files
from qlvbayes.use.exports.pad import ExportedPad
from qlvbayes.use.exports.reduction import closest, fitted, pressing
from qlvbayes.use.exports.target import AbstractTarget, Geometry

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
