"""Define the model of a specimen: elastic law, relaxation law, effects, and whether it can pull."""

from __future__ import annotations

from qlvbayes.effects.contacts import Adhesion
from qlvbayes.effects.effect import AbstractEffect, Level
from qlvbayes.io.checks import InputError
from qlvbayes.laws.elastic.law import AbstractElastic
from qlvbayes.laws.layered import Contact, Law, Layer
from qlvbayes.laws.motion import Motion
from qlvbayes.laws.relaxation.law import AbstractRelaxation
from qlvbayes.pytree import Pytree, static
from qlvbayes.xp import Array


class Model(Pytree):
    """Model of the force of a quasi-linear viscoelastic specimen (Fung), the paper's Eq. 6.

    Effects wrap the material; they nest innermost first, whatever the order in which they were
    added. A field of any part is a number (fixed) or a prior (free).

    elastic: The elastic law; relaxation: The relaxation law; bonded: Whether the specimen is fixed
    to the platen. One that is not cannot pull (`layered.Contact`); effects: The effects, innermost
    first.
    """

    elastic: AbstractElastic
    relaxation: AbstractRelaxation
    bonded: bool = static(default=False)
    effects: tuple[AbstractEffect, ...] = ()

    def __add__(self, effect: AbstractEffect) -> Model:
        """Return the model with one more effect.

        Raises InputError where the model has the effect already, or the effect cannot act on it.
        """
        if effect.name in [own.name for own in self.effects]:
            raise InputError(f"the effect {effect.name} is in the model already")
        if self.bonded and isinstance(effect, Adhesion):
            raise InputError(
                "adhesion changes nothing where the specimen is fixed to the platen",
                remedy="use --loose",
            )
        effects = tuple(sorted((*self.effects, effect), key=lambda x: (x.level, x.rank)))
        return Model(self.elastic, self.relaxation, self.bonded, effects)

    def without(self, name: str) -> Model:
        """Return the model without the effect of that name."""
        kept = tuple(effect for effect in self.effects if effect.name != name)
        return Model(self.elastic, self.relaxation, self.bonded, kept)

    def force(self, motion: Motion) -> Array:
        """Return the force (N,) in N at the motion's N points; every constant must be a number."""
        return self.law.force(motion)

    @property
    def reshaping(self) -> tuple[AbstractEffect, ...]:
        """Return the effects that change the relaxation: its constants alone are not the model's.

        They act on the material itself.
        """
        return tuple(effect for effect in self.effects if effect.level == Level.MATERIAL)

    def spectrum(self) -> tuple[Array, Array]:
        """Return the relaxation's fractions and rates, after the effects that change only these."""
        spectrum = self.relaxation.spectrum()
        for effect in self.effects:
            spectrum = effect.spectrum(*spectrum) or spectrum
        return spectrum

    @property
    def law(self) -> Law:
        """Return the force law: the material and its layers."""
        return Law(self.elastic, self.relaxation, self._layers())

    def _layers(self) -> tuple[Layer, ...]:
        """Return the effects, with a loose specimen's contact between those of pad and of depth."""
        if self.bonded or any(isinstance(effect, Adhesion) for effect in self.effects):
            return self.effects
        inner = sum(effect.level < Level.CONTACT for effect in self.effects)
        return (*self.effects[:inner], Contact(), *self.effects[inner:])
