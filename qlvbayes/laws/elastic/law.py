"""What every elastic law offers. A new one is one class in one file."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar, Self

import equinox as eqx
from jaxtyping import Array

from qlvbayes.laws.scales import Scales


class AbstractElastic(eqx.Module):
    """The force of an infinitely fast displacement, F_e(delta).

    A field is a constant: a number, or a prior while it is free. ``name`` as after ``--elastic``;
    ``units`` names the kind of unit of each constant (`units.UnitSystem.of`), ``meanings`` says
    each in a few words; ``law`` and ``reference``: for people, in one line each.
    ``listed``: whether it says what the elasticity is; a free curve, preferred to all that do, says
    that none is right.
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
        """The law with every constant free, under weakly informative priors at these scales."""

    @abstractmethod
    def force(self, depth: Array) -> Array:
        """F_e at ``depth`` (same shape), zero at zero depth."""

    @abstractmethod
    def stiffness(self, depth: Array) -> Array:
        """K = dF_e/d(depth)."""

    @abstractmethod
    def relaxed_step(
        self, start: Array, stop: Array, force_start: Array, force_stop: Array, decay: Array
    ) -> Array:
        r"""One step's part of a relaxing mode, for depth linear in time over the step.

        .. math:: \int_0^h e^{-v (h - s)} K(\delta(s)) \dot\delta \, ds

        ``start``, ``stop``: depths at both ends; ``force_start``, ``force_stop``: F_e there
        (known to the caller, who needs them anyway); ``decay``: v h >= 0.
        """
