"""Simulated tests of a pad with effects hidden in it, made ready for a diagnosis."""

from msgspec.structs import replace

from qlvbayes import Choices, prepare
from qlvbayes.benchmark.study import measured
from qlvbayes.diagnosis.verdict import Diagnosis
from qlvbayes.experiment import Experiment
from qlvbayes.fit import build_posterior
from qlvbayes.inference.subset import Ensemble, with_every_effect
from qlvbayes.synthetic import (
    NOISES,
    TABLE_1,
    Constants,
    HiddenPad,
    paper_protocol,
    record_study,
)

_ROWS = 300  # a test


def hidden_pad(
    *effects, rates, constants: Constants = TABLE_1["B"], seed=0, protocol=paper_protocol
) -> Experiment:
    """One test at each rate (mm/s), with correlated noise."""
    programs = {f"{rate:g}": protocol(rate) for rate in rates}
    pads = {"B": HiddenPad(constants, effects)}
    return prepare(measured(record_study(pads, programs, NOISES["correlated"], seed, _ROWS), "B"))


def said_otherwise(found: Diagnosis, **changes) -> Diagnosis:
    """The same diagnosis with other things said of it."""
    return Diagnosis(replace(found.result, **changes), found.work)


def ensemble_of(experiment: Experiment, *kinds) -> Ensemble:
    """The plain model of all tests with every effect of these kinds, each at its null."""
    posterior = build_posterior(experiment, Choices(noise="correlated"), experiment.trials)
    return with_every_effect(posterior, tuple(kind.default(experiment.scales) for kind in kinds))
