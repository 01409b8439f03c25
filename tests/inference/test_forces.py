"""The force of a hypothesis is that of the model, for every law and effect."""

from dataclasses import replace
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.spaces import space_of

from qlvbayes.effects.catalogue import EVERY
from qlvbayes.effects.drags import ViscousDrag
from qlvbayes.effects.frames import FrameCompliance
from qlvbayes.inference.forward.fixedrates import FixedRates
from qlvbayes.inference.forward.hypothesis import Hypothesis
from qlvbayes.inference.forward.space import FEW
from qlvbayes.laws.catalogue import LAWS
from qlvbayes.laws.relaxation.prony import Prony, Spectrum
from qlvbayes.model.model import Model
from qlvbayes.model.parameters import filled

SETS = 9  # one more than run together
PAIRS = [
    ("strain_dependent_rate",),  # of many modes: the material's own time
    ("viscous_drag", "friction"),
    ("contact_offset", "fluid_pressure"),
    ("frame_compliance", "channel_lag"),
    ("frame_compliance", "contact_offset"),
    ("extra_relaxation_mode", "strain_dependent_rate"),
    ("extra_relaxation_mode", "channel_lag"),
    ("strain_dependent_strength", "permanent_set"),
    ("adhesion", "spreading_lag"),
]


class Repeated(FrameCompliance):
    """Runs what is beneath in a loop of its own, as a user's effect may."""

    name: ClassVar[str] = "repeated"

    def force(self, below, motion):
        def again(force, _):
            depth = motion.displacement - self.compliance * force
            return below.force(replace(motion, displacement=depth)), None

        return jax.lax.scan(again, jnp.zeros_like(motion.time), None, length=3)[0]


class OwnDrag(ViscousDrag):
    """Makes arrays of JAX of whatever it is given, as a user's effect may."""

    name: ClassVar[str] = "own_drag"

    def force(self, below, motion):
        depth = jnp.maximum(motion.displacement, -1.0)
        force = below.force(replace(motion, displacement=depth))
        return jnp.asarray(force) + self.eta * jnp.where(depth > 0.5, motion.velocity, 0.0)


@pytest.fixture(scope="module")
def space(experiment):
    return space_of(experiment, experiment.trials[::3], (*EVERY, Repeated, OwnDrag))


def check(space, elastic="exponential", relaxation="prony:2", effects=()):
    """NumPy against JAX of the same constants, within rounding."""
    hypothesis = Hypothesis(elastic, relaxation, frozenset(effects))
    own = space.parameters(hypothesis)
    constants = own.constants(space.prior_draws(hypothesis)[:SETS])
    found = space.forces(hypothesis, constants)
    assert found.shape == (SETS, *np.shape(space.record.blocks.force))
    for k in (0, SETS - 1):
        model = as_run(space, filled(own.model, jnp.asarray(constants[k])))
        expected = np.asarray(by_jax(model, space.record))
        np.testing.assert_allclose(found[k], expected, rtol=0, atol=1e-11 * np.abs(expected).max())


@jax.jit
def by_jax(model, record):
    return jax.vmap(lambda test: test.average(model.force(test.motion)))(record)


def as_run(space, model):
    """The model; where it has many modes, by rates that all sets share."""
    relaxation = model.relaxation
    extra = [one for one in model.effects if one.name == "extra_relaxation_mode"]
    spectrum = relaxation.spectrum()
    for one in extra:
        spectrum = one.spectrum(*spectrum)
    if len(spectrum[1]) <= FEW:
        return model
    fixed = FixedRates.over(np.asarray(space.record.motion.time))
    shares = fixed.fractions(*(np.asarray(part)[None] for part in spectrum))[0]
    kept = tuple(one for one in model.effects if one not in extra)
    return Model(model.elastic, Spectrum(shares, fixed.rates), model.bonded, kept)


@pytest.mark.parametrize("elastic", [kind.name for kind in LAWS.elastic])
def test_of_every_elastic_law(space, elastic):
    check(space, elastic)


@pytest.mark.parametrize("relaxation", [k.name for k in LAWS.relaxation if k != Prony])
def test_of_every_relaxation(space, relaxation):
    check(space, "linear", relaxation)


@pytest.mark.parametrize("effects", PAIRS, ids="+".join)
@pytest.mark.few(3)
def test_of_pairs(space, effects):
    check(space, "hertz", "prony:2" if len(effects) > 1 else "fung", effects)


def test_of_three_modes_and_one_more(space):
    check(space, "linear", "prony:3", ["extra_relaxation_mode", "friction"])


@pytest.mark.parametrize("effects", [("repeated", "contact_offset"), ("own_drag",)])
def test_of_a_users_own_effect(space, effects):
    """One has a loop that NumPy does not run; the other makes arrays of JAX."""
    check(space, effects=effects)


def test_tests_of_unlike_lengths_keep_their_order(space, experiment):
    """Each test runs as long as it is: the longest one may have many times as many points."""
    hypothesis = Hypothesis("exponential", "prony:2", frozenset({"contact_offset"}))
    constants = space.parameters(hypothesis).constants(space.prior_draws(hypothesis)[:3])
    whole = space.forces(hypothesis, constants)
    longer = jax.tree.map(
        lambda x: np.concatenate([x, np.repeat(x[:, -1:], 4096 - x.shape[1], axis=1)], axis=1)
        if np.ndim(x) == 2 else x,
        space.record.motion,
    )  # fmt: skip
    record = type(space.record)(longer, space.record.nodes, space.record.blocks)
    np.testing.assert_allclose(space.forces(hypothesis, constants, record), whole, rtol=1e-12)
