"""Laws and effects give one force, whether NumPy runs many sets at once or JAX one test."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from qlvbayes import xp
from qlvbayes.effects.catalogue import EFFECTS, FORMS, OUTSIDE
from qlvbayes.effects.fluids import PowerLawDrainage
from qlvbayes.laws import recursion
from qlvbayes.laws.catalogue import LAWS
from qlvbayes.laws.elastic.exponential import Exponential
from qlvbayes.laws.motion import Motion
from qlvbayes.laws.relaxation.prony import Prony
from qlvbayes.laws.scales import Scales
from qlvbayes.model.model import Model
from qlvbayes.priors.distributions import AbstractPrior

SETS, SIZE = 3, 150  # of constants; points of a test
SCALES = Scales(
    1.6, 1.5, 1e-3, 60.0, 0.1, 0.1, 1.0, speed=100.0, acceleration=1e4, clock=900.0, stiffness=2.0
)


def one_test(speed, start, number, ago):
    """Press past 1 mm, hold, back off the pad, wait; the second half repeats it less deep."""
    corners = np.array([-0.05, 1.2, 1.2, 0.9, 0.9, -0.1, -0.1, 0.7, 0.7, -0.05])
    lasting = np.append(0.0, np.maximum(np.abs(np.diff(corners)) / speed, 0.3))
    ends = np.cumsum(lasting)
    time = np.unique(np.concatenate([ends, np.linspace(0.0, ends[-1], 150)]))
    depth = np.interp(time, ends, corners)
    velocity = np.append(np.diff(depth) / np.diff(time), 0.0)
    acceleration = np.append(np.diff(velocity) / np.diff(time), 0.0)
    bulge = 1e-3 * np.sin(time)
    earlier = np.where(time < ago, 1, 0)
    velocity, acceleration = (np.where(earlier, 0.0, x) for x in (velocity, acceleration))
    path = (x[:SIZE] for x in (time, depth, velocity, acceleration, earlier, bulge))
    time, depth, velocity, acceleration, earlier, bulge = path
    return Motion(time, depth, velocity, acceleration, start, earlier, bulge, number)


TESTS = [one_test(1.0, 0.0, 1.0, 0.2), one_test(30.0, 200.0, 2.0, 0.2)]


def together(tests):
    """Several tests of one length as NumPy arrays (N, T, 1), start and number (T, 1)."""

    def stacked(*values):
        rows = np.stack(values, axis=-1)[..., None]
        return rows if rows.ndim == 3 else rows.astype(float)

    return jax.tree.map(stacked, *tests)


def drawn(part, rng):
    """Return a law or effect with drawn constants, SETS times, and all of them as one of arrays."""
    leaves, structure = jax.tree.flatten(part, is_leaf=lambda x: isinstance(x, AbstractPrior))
    sets = [
        [np.asarray(x.draw(rng)) if isinstance(x, AbstractPrior) else np.asarray(x) for x in leaves]
        for _ in range(SETS)
    ]
    columns = [np.stack(values, axis=-1) for values in zip(*sets, strict=True)]
    singles = [jax.tree.unflatten(structure, [jnp.asarray(x) for x in own]) for own in sets]
    return singles, jax.tree.unflatten(structure, columns)


def check_equal(elastic, relaxation, effects=(), bonded=False):
    rng = np.random.default_rng(0)
    parts = [drawn(part, rng) for part in (elastic, relaxation, *effects)]
    motion = together(TESTS)

    def model(of_set):
        law, relaxing, *added = of_set
        total = Model(law, relaxing, bonded)
        for effect in added:
            total = total + effect
        return total

    with np.errstate(all="ignore"):
        quick = model([columns for _, columns in parts]).force(motion)
    assert isinstance(quick, np.ndarray)
    assert quick.shape == (SIZE, len(TESTS), SETS)
    slow = jax.jit(lambda own, moved: own.force(moved))
    for k in range(SETS):
        own = model([singles[k] for singles, _ in parts])
        for j, test in enumerate(TESTS):
            force = np.asarray(slow(own, jax.tree.map(jnp.asarray, test)))
            np.testing.assert_allclose(
                quick[:, j, k], force, rtol=0.0, atol=1e-11 * max(np.abs(force).max(), 1.0)
            )


BASE = Exponential.default(SCALES), Prony.default(SCALES)


@pytest.mark.parametrize("bonded", [False, True])
@pytest.mark.parametrize("kind", [*EFFECTS, *FORMS, *OUTSIDE], ids=lambda kind: kind.name)
@pytest.mark.few(6)
def test_an_effect_has_one_force(kind, bonded):
    if bonded and kind.family() == "adhesion":
        pytest.skip("nothing of it acts on a specimen that is fixed")
    check_equal(*BASE, [kind.default(SCALES)], bonded=bonded)


def test_numpy_runs_the_recursion_where_nothing_is_compiled(monkeypatch):
    """Of every elastic law; tests/inference/test_forces.py has them and relaxations compiled."""
    drains = [PowerLawDrainage.default(SCALES)]
    check_equal(*BASE, drains, bonded=False)
    monkeypatch.setattr(recursion, "_library", lambda: None)
    for kind in LAWS.elastic:
        check_equal(kind.default(SCALES), BASE[1], bonded=True)
    check_equal(*BASE, drains, bonded=False)


def test_functions_of_arrays_work_along_the_first_axis():
    rng = np.random.default_rng(1)
    x, index = rng.normal(size=(6, 2, 3)), rng.integers(0, 6, size=(4, 2, 3))
    for j in range(2):
        for k in range(3):
            row = x[:, j, k]
            assert np.array_equal(xp.take(x, index)[:, j, k], row[index[:, j, k]])
            order = np.sort(x, axis=0)
            found = xp.searchsorted(order, x)[:, j, k]
            assert np.array_equal(found, np.searchsorted(order[:, j, k], row))
    (summed,) = xp.accumulate(lambda a, b: (a[0] + b[0],), (x,))
    np.testing.assert_allclose(summed, np.cumsum(x, axis=0))
