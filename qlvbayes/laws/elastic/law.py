"""Define the interface of elastic laws. A new one is one class."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar, Self

from qlvbayes.laws.elastic.steps import Rise
from qlvbayes.laws.scales import Scales
from qlvbayes.pytree import Pytree
from qlvbayes.xp import Array


class AbstractElastic(Pytree):
    """Elastic law: the force F_e(delta) of an infinitely fast displacement.

    Each field is a constant of the law: a number where it is fixed, a prior where it is free. A law
    also declares

    * ``name``: its name after ``--elastic``,
    * ``units``: the kind of unit of each constant (a name that `UnitSystem.of` takes), and
      ``meanings``: what each means, unless its fields say both (`qlvbayes.pytree.constant`),
    * ``law`` and ``reference``: its formula and its source, in one line each,
    * ``listed``: whether it states a form of elasticity. A free curve states none: where it is
      preferred to every law that does, none of these is right.
    """

    name: ClassVar[str]
    units: ClassVar[dict[str, str]]
    meanings: ClassVar[dict[str, str]]
    law: ClassVar[str]
    reference: ClassVar[str]
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

    def rise(self, start: Array, stop: Array, force_start: Array, force_stop: Array) -> Rise:
        """Return how the force rises along a step on which depth is linear in time.

        ``start`` and ``stop`` are the depths at both ends (mm), ``force_start`` and ``force_stop``
        F_e there (N). The force is taken as quadratic through both ends and the middle of the step.
        A law with a polynomial or an exponential force defines it exactly instead.
        """
        return Rise.through(force_start, self.force(0.5 * (start + stop)), force_stop)

    def relaxed_step(
        self, start: Array, stop: Array, force_start: Array, force_stop: Array, decay: Array
    ) -> Array:
        r"""Return what one step adds to a relaxing mode, for depth linear in time over the step.

        .. math:: \int_0^h e^{-v (h - s)} K(\delta(s)) \dot\delta \, ds

        It follows from the rise of the force. A law whose integral has another closed form defines
        it instead. The arguments are those of ``rise``, and ``decay``, v h, zero or more.
        """
        return self.rise(start, stop, force_start, force_stop).relaxed(decay)
