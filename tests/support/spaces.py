"""All laws and some effects about tests of a pad."""

from qlvbayes.inference.forward.space import Space, in_natural_amplitude
from qlvbayes.laws.catalogue import LAWS
from qlvbayes.laws.relaxation.prony import Prony
from qlvbayes.model.noise import Correlated


def space_of(experiment, trials, effects):
    """Every law, with two and three Prony modes, and some effects, under default priors."""
    scales = experiment.scales
    relaxation = {f"prony:{k}": Prony.with_modes(scales, k) for k in (2, 3)}
    relaxation |= {kind.name: kind.default(scales) for kind in LAWS.relaxation if kind != Prony}
    return Space(
        experiment.record(trials),
        {kind.name: kind.default(scales) for kind in LAWS.elastic},
        relaxation,
        {k.name: in_natural_amplitude(k.default(scales)) for k in effects},
        Correlated.from_floor(experiment.floor),
        False,
    )
