"""What the user chose: the law, the number of modes, the noise, and single constants' priors."""

from __future__ import annotations

from dataclasses import asdict, dataclass

from qlvbayes.checks import InputError
from qlvbayes.defaults import LAWS, NOISES, Scales, default_model, default_noise
from qlvbayes.model import Model
from qlvbayes.noise import AbstractNoise
from qlvbayes.overrides import override, parse


@dataclass(frozen=True)
class Choices:
    """A model's description in words and numbers, as kept in the results.

    law: elastic law; modes: relaxation modes r; bonded: whether the specimen can pull; noise: kind
    of noise; priors, fixed: ``name=prior`` and ``name=number``, applied in this order.
    """

    law: str = "exponential"
    modes: int = 2
    bonded: bool = False
    noise: str = "correlated"
    priors: tuple[str, ...] = ()
    fixed: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        _one_of("elastic law", self.law, LAWS)
        _one_of("noise model", self.noise, NOISES)
        if self.modes < 1:
            raise InputError(f"{self.modes} relaxation modes", remedy="use one or more")

    def build(self, scales: Scales) -> tuple[Model, AbstractNoise]:
        """Model and noise with default priors at these scales, then the user's own.

        Raises InputError where a setting cannot be applied.
        """
        model = default_model(scales, self.law, self.modes, bonded=self.bonded)
        noise = default_noise(scales, self.noise)
        settings = [parse(text, fixed=False) for text in self.priors]
        settings += [parse(text, fixed=True) for text in self.fixed]
        of_noise = [s for s in settings if s[0].startswith("noise.")]
        of_model = [s for s in settings if not s[0].startswith("noise.")]
        return override(model, of_model), override(noise, of_noise)

    def as_dict(self) -> dict[str, object]:
        """For JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls, values: dict) -> Choices:
        """The inverse of ``as_dict``."""
        lists = {key: tuple(values[key]) for key in ("priors", "fixed")}
        return cls(**{**values, **lists})


def _one_of(what: str, value: str, known: tuple[str, ...]) -> None:
    if value not in known:
        raise InputError(f"no {what} {value!r}", remedy=f"use one of {', '.join(known)}")
