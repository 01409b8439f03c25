"""Point contact for Drake, without memory."""

from __future__ import annotations

from qlvbayes.use.exports.card import ONE_DRAW, card, in_comment, template
from qlvbayes.use.exports.pad import ExportedPad
from qlvbayes.use.exports.reduction import fitted, miss, pressing
from qlvbayes.use.exports.target import AbstractTarget, Geometry


class Drake(AbstractTarget):
    r"""Point contact stiffness and Hunt-Crossley dissipation, closest to the pad's force.

    .. math:: F = k\, x\, (1 + d\, \dot x)_+

    x: depth (m); k (N/m), d (s/m), neither below zero; in the mean square over ramps at the
    tested rates and holds. Two bodies in contact are in series: k is that of the pair if the other
    is hard.
    Hunt & Crossley 1975, doi:10.1115/1.3423596.
    """

    name = "drake"
    without_steps = "only as far as one stiffness and one dissipation go along with it"
    what = "proximity properties: stiffness in N/m, dissipation in s/m, in SDFormat"
    cannot = (
        "relaxation: no memory, one stiffness for ramp and hold",
        "stiffening with depth",
        ONE_DRAW,
    )

    def files(self, pad: ExportedPad, specimen: Geometry | None) -> dict[str, bytes]:
        """``pad_B.sdf``: paste its properties into a collision."""
        pressed = pressing(pad)
        spring = pressed.depth
        k, kd = fitted([spring, spring * pressed.speed], pressed.force)
        found = miss(k * spring + kd * spring * pressed.speed, pressed)
        extra = [f"so this {found}"]
        text = template(
            "pad.sdf.j2",
            card=in_comment(card(pad, type(self), extra)),
            name=pad.identifier,
            stiffness=float(k),
            dissipation=float(kd / k),
        )
        return {f"{pad.identifier}.sdf": text.encode()}
