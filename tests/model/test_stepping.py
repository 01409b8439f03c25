"""Force and displacement step by step: the batch answer, and there and back."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.stepped import DEPTH, DT, PRONY, SHALLOW, TIME, batch, relative, solved, stepped

from qlvbayes import Model
from qlvbayes.laws import (
    Cubic,
    Exponential,
    Fung,
    HertzPower,
    Linear,
    LogNormalSpectrum,
    PowerLaw,
    Prony,
    Quadratic,
    Spline,
    StretchedExponential,
    ToeExponential,
)
from qlvbayes.model.stepping import begin, begin_at_force, step

ELASTIC = [
    Exponential(0.34, 1.165),
    Exponential(0.34, 0.0),
    Linear(0.5),
    HertzPower(0.5, 1.5),
    Quadratic(0.3, 0.2),
    Cubic(0.3, 0.1, 0.05),
    Spline(0.3, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 1.6),
    ToeExponential(0.02, 1.5, 0.4),  # whose stiffness begins at almost nothing
]
RELAXATION = [
    PRONY,
    Fung(0.9, 0.05, 20.0),
    PowerLaw(0.2, 0.3, 0.1),
    StretchedExponential(0.3, 0.5, 0.4),
    LogNormalSpectrum(0.3, 0.5, 1.5),
]


@pytest.mark.parametrize("relaxation", RELAXATION, ids=lambda x: type(x).__name__)
@pytest.mark.few(1)
def test_steps_serve_every_relaxation(relaxation):
    model = Model(Exponential(0.34, 1.165), relaxation)
    assert relative(stepped(model, DEPTH, DT), batch(model, DEPTH)) < 1e-12
    back = solved(model, stepped(model, SHALLOW, DT), DT)
    assert relative(back, SHALLOW) < 1e-12


@pytest.mark.parametrize("elastic", ELASTIC, ids=repr)
@pytest.mark.parametrize("bonded", [False, True])
@pytest.mark.few(2)
def test_there_and_back(elastic, bonded):
    """Displacement to force and back in contact; force to displacement and back always."""
    model = Model(elastic, PRONY, bonded)
    back = solved(model, stepped(model, SHALLOW, DT), DT)
    assert relative(back, SHALLOW) < 1e-8
    force = np.asarray(stepped(model, DEPTH, DT))
    assert relative(force, batch(model, DEPTH)) < 1e-12
    if not bonded:
        assert np.sum(force == 0.0) > 50  # contact is lost
    assert relative(stepped(model, solved(model, force, DT), DT), force) < 1e-8


def test_a_ramp_may_be_cut_into_any_steps(paper_model):
    model = paper_model("B")
    once = step(model, begin(model), 1.6, 0.08)[1]
    for parts in (3, 40, 1000):
        path = jnp.linspace(0.0, 1.6, parts + 1)
        assert abs(stepped(model, path, 0.08 / parts)[-1] - once) < 1e-12 * once


def test_a_loose_specimen_is_never_pulled_and_a_bonded_one_is(paper_model):
    """Under no load the platen stays on the surface, which comes back by itself."""
    model = paper_model("B")
    load = np.where(TIME < 1.0, 1.0, np.where(TIME < 1.01, 0.5, -0.5))
    place = np.asarray(solved(model, load, DT))
    free = place[TIME >= 1.01]
    assert np.all(np.diff(free) < 0.0)
    assert free[0] > 0.1  # not back at once
    assert np.max(np.asarray(stepped(model, place, DT))[TIME >= 1.01]) < 1e-14
    # the surface is where a stuck platen would carry no force either
    stuck = paper_model("B", bonded=True)
    assert np.max(np.abs(np.asarray(stepped(stuck, place, DT))[TIME >= 1.01])) < 1e-14
    model = paper_model("B", bonded=True)
    place = solved(model, np.full(TIME.shape, -0.05), DT)
    assert np.all(np.asarray(place) < 0.0)
    assert relative(stepped(model, place, DT), np.full(TIME.shape, -0.05)) < 1e-12


def test_a_large_load_at_once_and_one_that_no_displacement_bears(paper_model):
    """Newton's first step from zero is far too long: the law grows by e every 0.9 mm."""
    model = paper_model("B")
    for force in (1e-6, 1.0, 1e3):
        place = begin_at_force(model, force)[1]
        constants = model.elastic
        assert np.isclose(place, np.log1p(force * constants.b / constants.m) / constants.b)
    softening = Model(Quadratic(0.5, -0.2), PRONY)  # at most 0.3125 N
    assert np.isnan(begin_at_force(softening, 0.5)[1])
    assert np.isclose(begin_at_force(softening, 0.2)[1], (0.5 - np.sqrt(0.25 - 0.16)) / 0.4)


@pytest.mark.slow
def test_slopes_of_the_displacement_are_those_of_differences(paper_model):
    model = paper_model("B")
    load = 0.2 + 0.1 * np.sin(TIME)

    def last(scale):
        elastic = Exponential(scale[0] * model.elastic.m, scale[1] * model.elastic.b)
        relaxation = Prony(model.relaxation.c, scale[2] * model.relaxation.v)
        return solved(Model(elastic, relaxation), scale[3] * load, DT)[-1]

    one, near = jnp.ones(4), 1e-5
    forward, backward = jax.jacfwd(last)(one), jax.grad(last)(one)
    differences = [
        (last(one + near * unit) - last(one - near * unit)) / (2.0 * near) for unit in np.eye(4)
    ]
    assert np.allclose(forward, differences, rtol=1e-6)
    assert np.allclose(backward, forward, rtol=1e-10)


def test_a_batch_of_draws_is_as_one_by_one(paper_model):
    models = [paper_model(pad) for pad in "ABC"]
    together = jax.tree.map(lambda *x: jnp.stack([jnp.asarray(y) for y in x]), *models)
    load = jnp.asarray(np.where(TIME < 2.0, 1.0, 0.0))
    found = jax.vmap(solved, in_axes=(0, None, None))(together, load, DT)
    for row, model in zip(found, models, strict=True):
        assert relative(row, solved(model, load, DT)) < 1e-12
