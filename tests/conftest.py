"""Double precision and the compile cache for every test, and the paper's pads as models."""

import jax.numpy as jnp
import pytest

from qlvbayes.io.runtime import configure, forget_compiled

configure()

from qlvbayes.laws.elastic.exponential import Exponential  # noqa: E402
from qlvbayes.laws.relaxation.prony import Prony  # noqa: E402
from qlvbayes.model.model import Model  # noqa: E402
from qlvbayes.simulate import TABLE_1  # noqa: E402


@pytest.fixture(scope="module", autouse=True)
def _forget_compiled():
    yield
    forget_compiled()


@pytest.fixture(scope="session")
def paper_model():
    """Give the model with the constants of a pad in the paper's Table 1."""

    def build(pad="B", *, bonded=False):
        constants = TABLE_1[pad]
        relaxation = Prony(jnp.array(constants.c), jnp.array(constants.v))
        return Model(Exponential(constants.m, constants.b), relaxation, bonded)

    return build
