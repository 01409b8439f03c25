"""Hold a user's choices: the laws, the number of modes, the noise, effects, and single priors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from qlvbayes.effects.catalogue import (
    EFFECTS,
    FORMS,
    OUTSIDE,
    find,
    installed_effects,
    own_effects,
)
from qlvbayes.effects.effect import AbstractEffect
from qlvbayes.io.checks import InputError, check_known
from qlvbayes.io.data import Pad
from qlvbayes.laws.catalogue import (
    LAWS,
    Laws,
    find_elastic,
    find_relaxation,
    installed_laws,
    own_laws,
)
from qlvbayes.laws.relaxation.prony import Prony
from qlvbayes.laws.scales import Scales
from qlvbayes.model.model import Model
from qlvbayes.model.noise import NOISES, AbstractNoise, Correlated, Floor
from qlvbayes.model.overrides import in_words, override, parse
from qlvbayes.model.parameters import fields_of, is_prior
from qlvbayes.motion.evidence import with_mass
from qlvbayes.motion.experiment import Experiment, prepare
from qlvbayes.priors import AbstractPrior

_NOMINAL = Scales(force=1.0, depth=1.0, shortest=0.01, longest=100.0, white=0.01, ou=0.01, tau=1.0)
"""Scales at which settings are tried: whether one can be applied depends on no test."""
Given = Sequence[str] | Mapping[str, AbstractPrior | float | str]


if TYPE_CHECKING:

    class _Settings:
        """Descriptor for which a type checker accepts more types than the field holds."""

        def __get__(self, instance: object, owner: type) -> tuple[str, ...]: ...

        def __set__(self, instance: object, given: Given) -> None: ...


@dataclass(frozen=True)
class Choices:
    """Description of a model in words and numbers, which the results keep.

    Parameters
    ----------
    elastic
        Name of the elastic law.
    modes
        Number of modes of a Prony series; other relaxation laws ignore it.
    bonded
        Whether the specimen is fixed to the platen, so that it can pull.
    noise
        Name of the noise model.
    priors
        Priors of single constants by name, ``{"v[1]": LogNormal(1.8, 0.5)}`` or ``{"v[1]":
        "lognormal(1.8,0.5)"}``, or as on the command line, ``["v[1]=lognormal(1.8,0.5)"]``, the
        form in which they are kept.
    fixed
        Values of single constants, ``{"v[2]": 0.14}`` or ``["v[2]=0.14"]``, applied after
        ``priors``.
    effects
        Names of the effects in the model; one alone may be a text.
    effects_file
        Python file with a user's own effects.
    rested
        Whether every test begins with a pad at rest, whatever came before it.
    relaxation
        Name of the relaxation law.
    laws_file
        Python file with a user's own laws.
    keep_all_readings
        Whether to keep readings that their neighbours and the other channel contradict.
    use
        Parts of tests to use, as ``TEST:0..18mm``.
    leave_out
        Parts of tests whose force does not count while their motion does, as ``TEST:30..45s`` or
        ``TEST:hold 2``.

    Raises
    ------
    InputError
        A law, effect or noise model of that name does not exist, a prior or a fixed value cannot be
        applied, or ``modes`` is below 1.
    """

    elastic: str = "exponential"
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
    leave_out: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("priors", "fixed"):
            object.__setattr__(self, name, _settings_in_words(getattr(self, name)))
        for name in ("effects", "use", "leave_out"):
            given = getattr(self, name)
            object.__setattr__(self, name, (given,) if isinstance(given, str) else tuple(given))
        find_elastic(self.elastic, self.laws)
        find_relaxation(self.relaxation, self.laws)
        check_known("noise model", self.noise, NOISES)
        if self.modes < 1:
            raise InputError(f"{self.modes} relaxation modes", remedy="use one or more")
        if self.effects_file is None or Path(self.effects_file).exists():  # else of old results
            self._added()
            if self.priors or self.fixed:
                self.build(_NOMINAL)

    def build(self, scales: Scales) -> tuple[Model, AbstractNoise]:
        """Return model and noise with default priors at these scales, then with the user's own.

        In both a number stands for each fixed constant, a prior for each free one. An InputError
        where a setting cannot be applied.
        """
        model = default_model(
            scales,
            self.elastic,
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

    def prepare(self, pad: Pad, *, all_tests: bool = False) -> Experiment:
        """Return the prepared tests of a pad: of the readings that these choices say are used.

        With ``all_tests`` every test is fitted, whatever its role. An InputError where more than 2
        % of a test's readings are bad, or too few are left.
        """
        prepared = prepare(
            pad,
            all_tests=all_tests,
            keep_all_readings=self.keep_all_readings,
            use=self.use,
            leave_out=self.leave_out,
        )
        return with_mass(prepared)

    def _added(self) -> list[type[AbstractEffect]]:
        """Return the effects in the model; raise InputError where two are of one family."""
        families: dict[str, type[AbstractEffect]] = {}
        for name in self.effects:
            kind = find(name, self.kinds)
            other = families.setdefault(kind.family(), kind)
            if other.name != name:
                raise InputError(
                    f"{other.name} and {name} are forms of one effect", remedy="add one of them"
                )
        return [find(name, self.kinds) for name in self.effects]

    @property
    def kinds(self) -> tuple[type[AbstractEffect], ...]:
        """Return every effect that can be added: those of the package and the user's own."""
        return (*EFFECTS, *FORMS, *OUTSIDE, *self._own_effects())

    @property
    def candidates(self) -> tuple[type[AbstractEffect], ...]:
        """Return the effects that a diagnosis looks for: the listed ones and the user's own."""
        return (*EFFECTS, *self._own_effects())

    def _own_effects(self) -> tuple[type[AbstractEffect], ...]:
        own = own_effects(Path(self.effects_file)) if self.effects_file else ()
        return (*installed_effects(), *own)

    @property
    def laws(self) -> Laws:
        """Return every law that can be chosen: those of the package and the user's own."""
        parts = [LAWS, installed_laws()]
        parts += [own_laws(Path(self.laws_file))] if self.laws_file else []
        elastic = tuple(kind for part in parts for kind in part.elastic)
        return Laws(elastic, tuple(kind for part in parts for kind in part.relaxation))

    @property
    def is_prony(self) -> bool:
        """Return whether the relaxation is a Prony series, of which ``modes`` counts the terms."""
        return self.relaxation == Prony.name

    @property
    def relaxing(self) -> str:
        """Return the relaxation as it is written after ``--relaxation``: ``prony:2``, ``fung``."""
        return f"{self.relaxation}:{self.modes}" if self.is_prony else self.relaxation

    def as_dict(self) -> dict[str, object]:
        """Return the choices as a dictionary for JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls, values: dict) -> Choices:
        """Return choices from a dictionary that ``as_dict`` made.

        Results without these keys are of tests from rest, and of all their readings. In older ones
        the elastic law is called ``law``, and the floor without a discrepancy ``correlated``.
        """
        if values.get("noise") == Correlated.name:
            values = {**values, "noise": Floor.name}
        values = {"elastic" if key == "law" else key: value for key, value in values.items()}
        names = ("priors", "fixed", "effects", "use", "leave_out")
        lists = {key: tuple(values.get(key, ())) for key in names}
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
    """Return a model with every constant free, each law under its own default priors."""
    elastic = find_elastic(law, laws).default(scales)
    kind = find_relaxation(relaxation, laws)
    relaxing = Prony.with_modes(scales, modes) if kind is Prony else kind.default(scales)
    return Model(elastic, relaxing, bonded)


def _settings_in_words(given: Given) -> tuple[str, ...]:
    """Return settings of any form as ``name=prior`` or ``name=number``."""
    if isinstance(given, Mapping):
        return tuple(f"{name}={in_words(value)}" for name, value in given.items())
    return (given,) if isinstance(given, str) else tuple(given)


def _check_floor(noise: Floor) -> None:
    """Raise InputError where a constant of the noise floor is given a prior or a bad value."""
    for field in fields_of(noise):
        if is_prior(field.value):
            raise InputError(
                f"{field.name} is measured, not fitted",
                remedy=f"fix it, as --fix {field.name}=NUMBER, or use --noise white",
            )
        if field.value < 0.0 or (
            field.value == 0.0 and field.name in ("noise.tau", "noise.factor")
        ):
            raise InputError(f"{field.name} must be positive", remedy="give a positive number")
