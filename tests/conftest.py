"""Double precision and the compile cache for every test, and the paper's pads as models."""

import jax
import jax.numpy as jnp
import pytest

from qlvbayes.runtime import configure

configure()

from qlvbayes.elastic import Exponential  # noqa: E402
from qlvbayes.model import Model  # noqa: E402
from qlvbayes.relaxation import Prony  # noqa: E402
from qlvbayes.synthetic import TABLE_1  # noqa: E402


@pytest.fixture(scope="module", autouse=True)
def _forget_compiled():
    """Drop compiled functions after each module: a process can map only so many of them."""
    yield
    jax.clear_caches()


@pytest.fixture(scope="session")
def paper_model():
    """Give the model with the constants of a pad in the paper's Table 1."""

    def build(pad="B", *, bonded=False):
        constants = TABLE_1[pad]
        relaxation = Prony(jnp.array(constants.c), jnp.array(constants.v))
        return Model(Exponential(constants.m, constants.b), relaxation, bonded)

    return build
