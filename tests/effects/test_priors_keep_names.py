"""Priors end where an effect would become another one: of its force something of its own is left.

The tests are those of the conformance suite: ramps and holds at six speeds with a return to half of
the depth, and one return to zero. What the constants of the base law can follow is taken away.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.signal import lsim

from qlvbayes.effects import conformance
from qlvbayes.effects.catalogue import find
from qlvbayes.effects.frames import FrameRinging
from qlvbayes.laws.layered import Law
from qlvbayes.priors.distributions import AbstractScalarPrior

DRAWS = 60  # of each prior: nearly all of a bounded one
SMALL = 0.7  # of the amplitude's prior sd

APART = [
    ("power_law_drag", "viscous_drag", 0.991),  # 0.998 with powers up to 0.9
    ("squeeze_film", "viscous_drag", 0.95),  # 0.976 with films of 6 depths
    ("fluid_leak", "conditioning", 0.985),  # 0.999 with 20 tests
    ("load_cell_creep", "channel_lag", 0.85),  # 0.957 with a creep of five samples
    ("friction", "permanent_set", 0.95),
    ("channel_lag", "squeeze_film", 0.3),  # a force that comes early would be one
    ("extra_relaxation_mode", "squeeze_film", 0.97),
    ("stiffening_frame", "contact_offset", 0.6),
]
"""Pairs of which one is near the other at an end of a prior: the largest cosine that is left."""


@pytest.fixture(scope="module")
def reference():
    return conformance._reference(1.6, 0.0)


@pytest.fixture(scope="module")
def own_part(reference):
    """What the constants of the base law leave of forces (D, T, N): (D, T N) of weight."""
    law = reference.law

    def force(constants):
        elastic = eqx.tree_at(lambda x: (x.m, x.b), law.elastic, tuple(constants[:2]))
        shares = jnp.concatenate([1.0 - constants[2:4].sum(keepdims=True), constants[2:4]])
        both = shares, constants[4:]
        relaxation = eqx.tree_at(lambda x: (x.c, x.v), law.relaxation, both)
        return jax.vmap(Law(elastic, relaxation, law.layers).force)(reference.motions)

    elastic, relaxation = law.elastic, law.relaxation
    at = jnp.concatenate([jnp.array([elastic.m, elastic.b]), relaxation.c[1:], relaxation.v])
    slopes = np.asarray(jax.jacfwd(force)(at)).reshape(-1, at.size)
    counts = np.diff(np.asarray(reference.motions.time), append=0.0).ravel() > 0.0
    basis, _ = np.linalg.qr(slopes * counts[:, None])

    def left(forces):
        rows = forces.reshape(len(forces), -1) * counts
        return rows - rows @ basis @ basis.T

    return left


def forces_of(kind, reference):
    """What an effect adds at draws of its shape, all of the same small amplitude."""
    default, rng = kind.default(reference.scales), np.random.default_rng(3)
    free = {n: p for n, p in vars(default).items() if isinstance(p, AbstractScalarPrior)}
    amplitude = next(iter(kind.null))
    trial = conformance._Trial(default, reference)
    run = jax.jit(lambda x: trial.forces(x, reference.motions))
    found = []
    for _ in range(DRAWS if len(free) > 1 else 1):
        values = {n: float(p.draw(rng)) for n, p in free.items()}
        values[amplitude] = SMALL * float(free[amplitude].sd)
        found.append(np.asarray(run(jnp.array([values[n] for n in trial.free]))))
    return np.array(found) - reference.baseline


def unit(rows):
    return rows / np.linalg.norm(rows, axis=1, keepdims=True)


@pytest.mark.parametrize(("name", "other", "most"), APART, ids=lambda x: str(x))
@pytest.mark.few(1)
def test_an_effect_keeps_a_force_of_its_own(reference, own_part, name, other, most):
    one, two = (unit(own_part(forces_of(find(x), reference))) for x in (name, other))
    assert np.max(one @ two.T) < most


@pytest.mark.parametrize("frequency", [2.0, 5.0, 10.0])
def test_ringing_rings_where_a_critically_damped_mass_is_inertia(reference, frequency):
    """With a machine that speeds up within 55 ms, by a general solver of the swing."""
    time = np.arange(0.0, 3.0, 5e-4)
    push = np.zeros_like(time)
    for sign, start in ((1.0, 0.1), (-1.0, 1.1)):
        along = (time - start) / 0.055
        push += np.where((along > 0.0) & (along < 1.0), sign * np.sin(np.pi * along) ** 2, 0.0)

    def cosine(damping):
        turn = 2.0 * np.pi * frequency
        g = turn * damping
        whole = g**2 + turn**2
        swing = lsim(([whole], [1.0, 2.0 * g, whole]), push, time)[1]
        return push @ swing / np.linalg.norm(push) / np.linalg.norm(swing)

    damping = FrameRinging.default(reference.scales).damping
    assert cosine(damping.low) < cosine(damping.high) < 0.5
    assert cosine(23.0) > 0.9
    # the first swing back has a quarter of the first swing at the least
    assert np.exp(-np.pi * damping.high) > 0.25
