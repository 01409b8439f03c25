"""What errors of the motion make of the force of inertia, drags and ringing."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.motions import constant_jerk, read, sampled
from support.spaces import space_of

from qlvbayes import read_study
from qlvbayes.effects.catalogue import EFFECTS
from qlvbayes.inference.errors.motionerrors import motion_columns, rated
from qlvbayes.inference.errors.whitening import Whitener
from qlvbayes.inference.forward.hypothesis import Hypothesis
from qlvbayes.motion.experiment import prepare

MASS, NOISE = 0.002, 0.003  # N s2/mm, N
RISE = 0.03  # s, in which the acceleration reaches its limit


def in_air(path):
    """A mass moves from 1 mm off and back, limited in jerk, with nothing under it, at 100 Hz."""
    rng = np.random.default_rng(2)
    with path.open("w") as sink:
        sink.write("pad,test,time_s,displacement_mm,force_N\n")
        for name, speed in (("slow", 8.0), ("middle", 12.0), ("fast", 16.0)):
            jerk = speed / RISE**2
            rows = [(0.5031, 0.0, 0.0, 0.0)]
            for sign in (1.0, -1.0):
                for turn in (sign, -sign):
                    rows += [(RISE, turn * jerk, 0.0, None)]
                    rows += [(RISE, -turn * jerk, turn * jerk * RISE, None)]
                    if turn == sign:
                        rows.append((10.0 / speed, 0.0, 0.0, sign * speed))
                rows.append((1.5, 0.0, 0.0, 0.0))
            motion = constant_jerk(rows, 3)
            t = sampled(motion, 0.01)
            x, _, a = motion.at(t)
            force = MASS * a + NOISE * rng.normal(size=t.size)
            for row in zip(t, read(x - 1.0, 3e-4)[0], force, strict=True):
                sink.write(f"air,{name}," + ",".join(f"{value:.6f}" for value in row) + "\n")
    return path


@pytest.fixture(scope="module")
def experiment(tmp_path_factory):
    file = in_air(tmp_path_factory.mktemp("air") / "air.csv")
    return prepare(read_study(file).pads[0], all_tests=True)


@pytest.fixture(scope="module")
def space(experiment):
    space = space_of(experiment, experiment.trials, EFFECTS)
    errors = experiment.record(experiment.trials, errors=True)
    return type(space)(
        errors, space.elastic, space.relaxation, space.effects, space.noise, space.bonded
    )


@pytest.fixture(scope="module")
def whitener(experiment, space):
    return Whitener.from_floor(experiment.floor, space.record.blocks, experiment.peak)


def columns_of(space, whitener, *effects, **constants):
    hypothesis = Hypothesis("exponential", "prony:2", frozenset(effects))
    own = space.parameters(hypothesis)
    row = np.zeros((1, len(own.names)))
    for name, value in constants.items():
        row[:, own.names.index(name.replace("__", "."))] = value
    return motion_columns(space, whitener, hypothesis, row[0]), hypothesis


def test_there_are_none_without_speed_or_stated_errors_nor_within_the_noise(
    space, whitener, experiment
):
    columns, hypothesis = columns_of(space, whitener, "friction")
    assert rated(space, hypothesis) == []
    assert columns.shape == (0, *space.real.shape)
    columns, _ = columns_of(space, whitener, "inertia", inertia__mass=1e-9)
    assert len(columns) == 0
    plain = space_of(experiment, experiment.trials, EFFECTS)
    assert columns_of(plain, whitener, "inertia", inertia__mass=MASS)[0].shape[0] == 0


def test_the_force_of_a_mass_is_off_by_the_mass_times_the_error_of_the_acceleration(
    space, whitener
):
    columns, _ = columns_of(space, whitener, "inertia", inertia__mass=MASS)
    sds = jax.vmap(
        lambda record: jnp.sqrt(
            jnp.sum(jax.vmap(record.average)(record.errors.acceleration) ** 2, axis=0)
        )
    )(space.record)
    stated = np.sqrt(np.sum(columns**2, axis=0))
    expected = MASS * np.where(space.real, np.asarray(sds), 0.0)
    np.testing.assert_allclose(stated, expected, atol=0.3 * NOISE)
    assert stated.max() > 5.0 * NOISE
    assert all(np.count_nonzero(np.any(one != 0.0, axis=1)) == 1 for one in columns)  # of one test
    double, _ = columns_of(space, whitener, "inertia", inertia__mass=2.0 * MASS)
    np.testing.assert_allclose(np.abs(double).max(), 2.0 * np.abs(columns).max(), rtol=1e-6)


def test_what_is_left_of_a_known_mass_is_what_is_stated(space, whitener):
    """Over all block means; as if the motion were exact it is twice as much."""
    columns, _ = columns_of(space, whitener, "inertia", inertia__mass=MASS)
    motion, nodes = space.record.motion, np.asarray(space.record.nodes)
    acceleration = np.take_along_axis(
        np.asarray(motion.acceleration)[:, None], nodes.transpose(0, 2, 1), axis=2
    ).mean(axis=1)
    left = whitener((np.asarray(space.record.blocks.force) - MASS * acceleration)[None])[0]
    rows = whitener(columns)
    assert np.abs(left).max() > 6.0
    squares = left @ np.linalg.solve(np.eye(left.size) + rows.T @ rows, left)
    assert left @ left > 1.4 * left.size
    assert 0.6 < squares / left.size < 1.3


@pytest.mark.parametrize(
    ("name", "constants"),
    [
        ("viscous_drag", {"viscous_drag__eta": 0.05}),
        ("frame_ringing", {"frame_ringing__strength": 0.02, "frame_ringing__frequency": 20.0,
                           "frame_ringing__damping": 0.1}),
    ],
)  # fmt: skip
def test_drags_and_ringing_have_errors_in_ramp_ups_alone(space, whitener, name, constants):
    columns, _ = columns_of(space, whitener, name, **constants)
    assert len(columns) > 0
    where = np.any(np.abs(columns) > 0.1 * NOISE, axis=0) & space.real
    assert 0.0 < where.sum() < 0.5 * space.real.sum()


def test_a_platen_off_the_specimen_drags_through_no_film(space, whitener):
    columns, _ = columns_of(
        space, whitener, "squeeze_film", squeeze_film__eta=0.05, squeeze_film__h=100.0
    )
    motion, nodes = space.record.motion, np.asarray(space.record.nodes)
    off = np.asarray(motion.displacement) <= 0.0
    untouched = np.stack([np.all(out[at], axis=1) for out, at in zip(off, nodes, strict=True)])
    assert untouched.any()
    assert not np.any(columns[:, untouched])
