"""What the user chose: the law, the number of modes, the noise, and single constants' priors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from qlvbayes.effects.catalogue import EFFECTS, FORMS, OUTSIDE, find, own_effects
from qlvbayes.effects.effect import AbstractEffect
from qlvbayes.io.checks import InputError
from qlvbayes.laws.catalogue import LAWS, Laws, find_elastic, find_relaxation, own_laws
from qlvbayes.laws.relaxation.prony import Prony
from qlvbayes.laws.scales import Scales
from qlvbayes.model.model import Model
from qlvbayes.model.noise import NOISES, AbstractNoise, Floor
from qlvbayes.model.overrides import in_words, override, parse
from qlvbayes.model.parameters import fields_of
from qlvbayes.model.posterior import is_prior
from qlvbayes.priors import AbstractPrior

Given = Sequence[str] | Mapping[str, AbstractPrior | float | str]


if TYPE_CHECKING:

    class _Settings:
        """A field to which more may be given than it holds."""

        def __get__(self, instance: object, owner: type) -> tuple[str, ...]: ...

        def __set__(self, instance: object, given: Given) -> None: ...


@dataclass(frozen=True)
class Choices:
    """A model's description in words and numbers, as kept in the results.

    law: elastic law; modes: r of a Prony series, of no account to other relaxations; bonded:
    whether the specimen can pull; noise: kind of noise; priors, fixed: of single constants, applied
    in this order, by name (``{"v[1]": LogNormal(1.8, 0.5)}`` or ``{"v[1]": "lognormal(1.8,0.5)"}``,
    ``{"v[2]": 0.14}``) or as on the command line (``["v[2]=0.14"]``), as which they are kept;
    effects: names of the effects in the model;
    effects_file: a user's own effects; rested: whether every test begins with a pad at rest,
    whatever came before it; relaxation: its law; laws_file: a user's own laws; keep_all_readings:
    whether readings stay that their neighbours and the other channel contradict; use: of which
    tests a part is used, as ``TEST:0..18mm``.
    """

    law: str = "exponential"
    modes: int = 2
    bonded: bool = False
    noise: str = "floor"
    if TYPE_CHECKING:
        priors: _Settings = _Settings()
        fixed: _Settings = _Settings()
    else:
        priors: tuple[str, ...] = ()
        fixed: tuple[str, ...] = ()
    effects: tuple[str, ...] = ()
    effects_file: str | None = None
    rested: bool = False
    relaxation: str = "prony"
    laws_file: str | None = None
    keep_all_readings: bool = False
    use: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("priors", "fixed"):
            object.__setattr__(self, name, _settings_in_words(getattr(self, name)))
        find_elastic(self.law, self.laws)
        find_relaxation(self.relaxation, self.laws)
        if self.noise not in NOISES:
            raise InputError(
                f"no noise model {self.noise!r}", remedy=f"use one of {', '.join(NOISES)}"
            )
        if self.modes < 1:
            raise InputError(f"{self.modes} relaxation modes", remedy="use one or more")

    def build(self, scales: Scales) -> tuple[Model, AbstractNoise]:
        """Model and noise with default priors at these scales, then the user's own.

        Raises InputError where a setting cannot be applied.
        """
        model = default_model(
            scales,
            self.law,
            self.modes,
            relaxation=self.relaxation,
            laws=self.laws,
            bonded=self.bonded,
        )
        for kind in self._added():
            model = model + kind.default(scales)
        noise: AbstractNoise = NOISES[self.noise].default(scales)
        settings = [parse(text, fixed=False) for text in self.priors]
        settings += [parse(text, fixed=True) for text in self.fixed]
        of_noise = [s for s in settings if s[0].startswith("noise.")]
        of_model = [s for s in settings if not s[0].startswith("noise.")]
        noise = override(noise, of_noise)
        if isinstance(noise, Floor):
            _check_floor(noise)
        return override(model, of_model), noise

    def _added(self) -> list[type[AbstractEffect]]:
        """The effects in the model; InputError where two are of one family."""
        found: dict[str, type[AbstractEffect]] = {}
        for name in self.effects:
            kind = find(name, self.kinds)
            other = found.setdefault(kind.family(), kind)
            if other.name != name:
                raise InputError(
                    f"{other.name} and {name} are forms of one effect", remedy="add one of them"
                )
        return [find(name, self.kinds) for name in self.effects]

    @property
    def kinds(self) -> tuple[type[AbstractEffect], ...]:
        """Every effect that can be added, those of the package and the user's own."""
        return (*EFFECTS, *FORMS, *OUTSIDE, *self._own_effects())

    @property
    def candidates(self) -> tuple[type[AbstractEffect], ...]:
        """Effects that a diagnosis looks for: the list, and the user's own."""
        return (*EFFECTS, *self._own_effects())

    def _own_effects(self) -> tuple[type[AbstractEffect], ...]:
        return own_effects(Path(self.effects_file)) if self.effects_file else ()

    @property
    def laws(self) -> Laws:
        """Every law that can be chosen, those of the package and the user's own."""
        if not self.laws_file:
            return LAWS
        own = own_laws(Path(self.laws_file))
        return Laws(LAWS.elastic + own.elastic, LAWS.relaxation + own.relaxation)

    @property
    def is_prony(self) -> bool:
        """Whether relaxation is a Prony series, of which ``modes`` counts the terms."""
        return self.relaxation == Prony.name

    @property
    def relaxing(self) -> str:
        """The relaxation as after ``--relaxation``: ``prony:2``, ``fung``."""
        return f"{self.relaxation}:{self.modes}" if self.is_prony else self.relaxation

    def as_dict(self) -> dict[str, object]:
        """For JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls, values: dict) -> Choices:
        """The inverse of ``as_dict``.

        Results that do not say so are of tests from rest, and of all their readings.
        """
        lists = {key: tuple(values.get(key, ())) for key in ("priors", "fixed", "effects", "use")}
        return cls(**{"rested": True, "keep_all_readings": True, **values, **lists})


def default_model(
    scales: Scales,
    law: str = "exponential",
    modes: int = 2,
    *,
    relaxation: str = "prony",
    laws: Laws = LAWS,
    bonded: bool = False,
) -> Model:
    """QLV model with every constant free, each law under its own default priors.

    law, relaxation: names of an elastic law and of a relaxation among ``laws``; modes: of a Prony
    series. Raises InputError where there is no law of that name.
    """
    elastic = find_elastic(law, laws).default(scales)
    kind = find_relaxation(relaxation, laws)
    relaxing = Prony.with_modes(scales, modes) if kind is Prony else kind.default(scales)
    return Model(elastic, relaxing, bonded)


def _settings_in_words(given: Given) -> tuple[str, ...]:
    """``name=prior`` and ``name=number``, of whatever form."""
    if isinstance(given, Mapping):
        return tuple(f"{name}={in_words(value)}" for name, value in given.items())
    return (given,) if isinstance(given, str) else tuple(given)


def _check_floor(noise: Floor) -> None:
    """InputError where a constant of the measured floor is given as anything but a size."""
    for field in fields_of(noise):
        if is_prior(field.value):
            raise InputError(
                f"{field.name} is measured, not fitted",
                remedy=f"fix it, as --fix {field.name}=NUMBER, or use --noise correlated",
            )
        if field.value < 0.0 or (
            field.value == 0.0 and field.name in ("noise.tau", "noise.factor")
        ):
            raise InputError(f"{field.name} must be positive", remedy="give a positive number")
