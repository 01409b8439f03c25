"""Define the interface of elastic laws. A new one is one class in one file."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar, Self

import equinox as eqx
from jaxtyping import Array

from qlvbayes.laws.elastic.steps import quadratic_force_step
from qlvbayes.laws.scales import Scales


class AbstractElastic(eqx.Module):
    """Elastic law: the force F_e(delta) of an infinitely fast displacement.

    Each field is a constant of the law: a number where it is fixed, a prior where it is free. A law
    also declares

    * ``name``: its name after ``--elastic``,
    * ``units``: the kind of unit of each constant (a name that `UnitSystem.of` takes),
    * ``meanings``: what each constant means, in a few words,
    * ``law`` and ``reference``: its formula and its source, in one line each,
    * ``listed``: whether it states a form of elasticity. A free curve states none: where it is
      preferred to every law that does, none of these is right.
    """

    name: eqx.AbstractClassVar[str]
    units: eqx.AbstractClassVar[dict[str, str]]
    meanings: eqx.AbstractClassVar[dict[str, str]]
    law: eqx.AbstractClassVar[str]
    reference: eqx.AbstractClassVar[str]
    listed: ClassVar[bool] = True

    @classmethod
    @abstractmethod
    def default(cls, scales: Scales) -> Self:
        """Return the law with every constant free, under weak priors at these scales."""

    @abstractmethod
    def force(self, depth: Array) -> Array:
        """Return F_e in N at ``depth`` (mm), of the same shape; it is zero at zero depth."""

    @abstractmethod
    def stiffness(self, depth: Array) -> Array:
        """Return K = dF_e/d(depth) in N/mm at ``depth`` (mm), of the same shape."""

    def relaxed_step(
        self, start: Array, stop: Array, force_start: Array, force_stop: Array, decay: Array
    ) -> Array:
        r"""Return what one step adds to a relaxing mode, for depth linear in time over the step.

        .. math:: \int_0^h e^{-v (h - s)} K(\delta(s)) \dot\delta \, ds

        The force is taken as quadratic through both ends and the middle of the step. A law whose
        integral has a closed form defines it instead. ``start`` and ``stop`` are the depths at both
        ends (mm), ``force_start`` and ``force_stop`` F_e there (N), ``decay`` is v h, zero or more.
        """
        middle = self.force(0.5 * (start + stop))
        return quadratic_force_step(force_start, middle, force_stop, decay)
