"""A saved fit and draws of its constants, to predict and step from."""

import numpy as np

from qlvbayes.fitting.results import Saved
from qlvbayes.model.choices import Choices
from qlvbayes.motion.facts import Covered
from qlvbayes.simulate import TABLE_1

PAD = TABLE_1["B"]


def draws(count=200, **effects):
    """Draws about the constants of the paper's pad B."""
    rng = np.random.default_rng(0)
    values = {"m": PAD.m, "b": PAD.b, "v[1]": PAD.v[0], "v[2]": PAD.v[1]} | effects
    found = {name: x * np.exp(0.03 * rng.standard_normal(count)) for name, x in values.items()}
    shares = rng.dirichlet(2e3 * np.array(PAD.c), count)
    return found | {f"c[{k}]": shares[:, k] for k in range(3)}


REACH = Covered(depth=1.6, slowest=0.1, fastest=40.0, quickest=0.05, hold=30.0, tests=6)


def saved(**effects):
    given = draws(**effects)
    names = {name.split(".")[0] for name in effects}
    choices = Choices(effects=tuple(names), noise="white")
    columns = np.stack(list(given.values()), axis=-1)[None]
    return Saved(
        "B", tuple(given), columns, choices, "emcee", "", "", False, ("20",), covered=REACH
    )
