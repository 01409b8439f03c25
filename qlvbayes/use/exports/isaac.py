"""Compliant contact for Isaac Sim and other users of PhysX, without memory."""

from __future__ import annotations

from qlvbayes.use.exports.card import ONE_DRAW, card, commented, template
from qlvbayes.use.exports.contact import spring_damper
from qlvbayes.use.exports.errors import error_files
from qlvbayes.use.exports.pad import ExportedPad
from qlvbayes.use.exports.reduction import closest, fitted, pressing
from qlvbayes.use.exports.target import AbstractTarget, Geometry


class Isaac(AbstractTarget):
    r"""``compliantContactStiffness`` and ``compliantContactDamping`` of a physics material.

    .. math:: F = (k\, x + c\, \dot x)_+

    x: depth (m); k (N/m), c (N s/m), neither below zero; in the mean square along the pad's tests.
    PhysX takes it implicitly, in steps that are to be short against c/k. A compliant material
    against a rigid one keeps its own constants. OpenUSD, ``PhysxMaterialAPI``.
    """

    name = "isaac"
    without_steps = "only as far as one stiffness and one damping can represent it"
    what = "a physics material with compliant contact: stiffness and damping, in USD; their error"
    cannot = (
        "relaxation: no memory, one stiffness for ramp and hold",
        "stiffening with depth",
        ONE_DRAW,
    )

    def files(self, pad: ExportedPad, specimen: Geometry | None) -> dict[str, bytes]:
        """Return the content of ``pad_B.usda``, the material of a collider, and of its errors."""
        pressed = pressing(pad)
        start = fitted([pressed.depth, pressed.speed], pressed)
        stiffness, damping = closest(spring_damper, pressed, start.tolist())
        force = spring_damper(pressed.depth, pressed.speed, stiffness, damping)
        text = template(
            "pad.usda.j2",
            card=commented(card(pad, type(self), [f"so this {pressed.miss(force)}"]), "#"),
            name=pad.identifier,
            stiffness=stiffness,
            damping=damping,
        )
        constants = {"stiffness (N/m)": stiffness, "damping (N s/m)": damping}
        return {
            f"{pad.identifier}.usda": text.encode(),
            **error_files(pad, type(self), pressed, {"compliant contact": force}, constants),
        }
