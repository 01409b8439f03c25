"""Block averages: no sample lost, exact nodes, and as much learned as from every sample."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from qlvbayes.model.posterior import Posterior

from qlvbayes.io.data import Test
from qlvbayes.laws.scales import Scales
from qlvbayes.model.choices import default_model
from qlvbayes.model.noise import Correlated, White
from qlvbayes.motion.phases import find_phases
from qlvbayes.motion.record import batch
from qlvbayes.motion.reduction import clear_of_kinks, reduce_test
from qlvbayes.motion.trajectory import smooth
from qlvbayes.simulate import NOISES, TABLE_1, Pad, Platen, encode, paper_protocol

CONSTANTS = TABLE_1["B"]
MODEL = default_model(
    Scales(force=2.0, depth=1.6, shortest=1e-3, longest=30.0, white=0.006, ou=0.008, tau=0.5)
)
CELL = NOISES["correlated"]
NOISE = {
    "white": White(NOISES["white"].white),
    "correlated": Correlated(CELL.white, CELL.correlated, CELL.correlation_time),
}


@pytest.fixture(scope="module")
def record():
    """The paper's test at 1 kHz, 61 000 samples and more, without noise; kept once made."""
    made = {}

    def at(rate):
        if rate not in made:
            platen = Platen(paper_protocol(rate))
            time = np.arange(int(1e3 * platen.duration)) / 1e3
            force = Pad(CONSTANTS).force(platen, time)
            test = Test("t", "B", time, encode(platen.displacement(time)), force)
            trajectory = smooth(test.time, test.displacement)
            made[rate] = test, trajectory, find_phases(trajectory)
        return made[rate]

    return at


def with_force(test, force, force_sd=None):
    return Test(test.name, test.pad, test.time, test.displacement, force, force_sd)


def test_every_sample_clear_of_kinks_is_in_exactly_one_block(record):
    test, trajectory, phases = record(20.0)
    noisy = with_force(test, np.random.default_rng(1).standard_normal(test.time.size))
    blocks = reduce_test(noisy, trajectory, phases).blocks
    owners = np.zeros(test.time.size, dtype=int)
    for first, last, count, force in zip(
        blocks.first, blocks.last, blocks.count, blocks.force, strict=True
    ):
        inside = (test.time >= first) & (test.time <= last)
        owners += inside
        assert inside.sum() == count
        assert np.isclose(noisy.force[inside].mean(), force, rtol=0, atol=1e-12)
    assert owners.max() == 1
    kinks = np.concatenate([[0.0], trajectory.kinks])
    nearest = np.abs(test.time[:, None] - kinks).min(axis=1)
    assert np.all(nearest[owners == 0] < 0.1)  # slow kinks are known to some hundredths
    assert np.sum(owners == 0) < 0.03 * test.time.size
    assert blocks.last[-1] == test.time[-1]


def test_a_sample_next_to_a_kink_is_left_out(record):
    test, trajectory, phases = record(20.0)
    blocks = reduce_test(test, trajectory, phases).blocks
    for kink in trajectory.kinks:
        assert not np.any((blocks.first < kink + 1e-3) & (blocks.last > kink - 1e-3))


def test_no_block_crosses_the_end_of_a_phase(record):
    test, trajectory, phases = record(20.0)
    blocks = reduce_test(test, trajectory, phases).blocks
    for phase in phases[:-1]:
        assert not np.any((blocks.first < phase.stop) & (blocks.last > phase.stop))


def test_unreduced_samples_are_kept_as_they_are(record):
    test, trajectory, phases = record(20.0)
    kept = reduce_test(test, trajectory, phases, blocks=False)
    assert np.array_equal(kept.blocks.force, test.force)
    assert np.all(kept.blocks.count == 1.0)
    nodes = np.asarray(kept.motion.time)[np.asarray(kept.nodes)]
    np.testing.assert_allclose(nodes.mean(axis=1), test.time, rtol=0.0, atol=1e-12)
    apart = np.diff(nodes, axis=1)[:, 0]
    interval = np.median(np.diff(test.time))
    to_kinks = np.min(np.abs(test.time[:, None] - trajectory.kinks), axis=1)
    assert not apart[to_kinks > 1e-3 * interval].any()
    assert np.all(apart <= 2.001e-3 * interval)


def test_two_nodes_average_a_cubic_exactly(record):
    test, trajectory, phases = record(20.0)
    coefficients = [2e-5, -3e-3, 0.07, 1.0]
    cubic = with_force(test, np.polyval(coefficients, test.time))
    reduced = reduce_test(cubic, trajectory, phases)
    nodes = jnp.polyval(jnp.array(coefficients), reduced.motion.time)
    assert np.allclose(reduced.average(nodes), reduced.blocks.force, rtol=1e-12)


def test_weights_are_the_measured_sds_over_their_scale(record):
    test, trajectory, phases = record(20.0)
    even = with_force(test, test.force, np.full(test.time.size, 0.03))
    assert np.allclose(reduce_test(even, trajectory, phases, sd_scale=0.02).blocks.weight, 1.5)
    sd = 0.01 * np.exp(0.3 * np.sin(test.time))
    reduced = reduce_test(with_force(test, test.force, sd), trajectory, phases, sd_scale=0.01)
    squares = reduced.blocks.weight**2 @ reduced.blocks.count
    used = clear_of_kinks(test.time, trajectory, phases)
    assert np.isclose(squares, np.sum((sd[used] / 0.01) ** 2), rtol=1e-12)


@pytest.mark.parametrize("rate", [0.1, 100.0])
def test_motion_on_the_grid_follows_the_trajectory(record, rate):
    """Between the grid's points too, to a fraction of the encoder's step of 1 um."""
    test, trajectory, phases = record(rate)
    motion = reduce_test(test, trajectory, phases).motion
    assert np.all(np.diff(motion.time) > 0.0)
    assert np.isin(trajectory.kinks, motion.time).all()
    straight = np.interp(test.time, motion.time, motion.displacement)
    after = np.clip(np.searchsorted(motion.time, test.time), 1, motion.time.size - 1)
    share = (motion.time[after] - test.time) / np.diff(motion.time)[after - 1]
    sagitta = np.zeros(motion.time.size) if motion.sagitta is None else motion.sagitta
    curved = straight + 4.0 * sagitta[after] * np.clip(share * (1.0 - share), 0.0, None)
    assert np.max(np.abs(curved - trajectory.displacement(test.time))) < 0.3e-3


def test_a_record_that_begins_on_the_move_is_given_its_approach():
    time = 0.05 + np.arange(0.0, 1.0, 1e-2)
    test = Test("t", "p", time, 1.5 * time, np.zeros(time.size))
    trajectory = smooth(time, test.displacement)
    motion = reduce_test(test, trajectory, find_phases(trajectory)).motion
    assert motion.time[0] == pytest.approx(0.0, abs=1e-6)
    assert motion.displacement[0] == 0.0
    assert np.allclose(motion.displacement, 1.5 * motion.time, atol=1e-6)


def test_batching_changes_no_density(record):
    """Tests of different lengths, padded to one size."""
    records = [reduce_test(*record(rate)) for rate in (1.0, 20.0)]
    separate = [Posterior(MODEL, NOISE["correlated"], batch([single])) for single in records]
    theta = truth(separate[0])
    together = Posterior(MODEL, NOISE["correlated"], batch(records))
    total, *parts = (float(log_likelihood(x, theta)) for x in (together, *separate))
    assert np.isclose(total, sum(parts), rtol=1e-12)


def truth(posterior):
    """Theta at the constants of the simulated pad, the noise being fixed."""
    constants = [CONSTANTS.m, CONSTANTS.b, *CONSTANTS.c, *CONSTANTS.v]
    noise = jax.tree.leaves(posterior.noise)
    return jnp.asarray(posterior.unconstrain(np.array([*constants, *noise])))


@jax.jit
def log_likelihood(posterior, theta):
    return posterior.log_likelihood(theta)


@jax.jit
def constant_slopes(posterior, theta):
    """(7, D) derivatives of the model's constants by theta."""
    return jax.jacfwd(lambda x: posterior.constants(x)[:7])(theta)


@jax.jit
def information(posterior, theta):
    """Fisher information (D, D) at theta and the score (D,) of the record there.

    Minus the log likelihood of residuals r is r' S r / 2 plus a constant, S unknown; its values at
    sums of two columns of the model's slopes give all products between columns.
    """
    single = jax.tree.map(lambda leaf: leaf[0], posterior.record)
    slopes = jax.jacfwd(lambda x: posterior.predict(x)[0])(theta)
    residual = single.blocks.force - posterior.predict(theta)[0]
    columns = jnp.column_stack([slopes, residual])

    def power(r):
        return -jnp.sum(posterior.noise.log_likelihoods(r, single.blocks))

    def product(pair):
        one, two = columns[:, pair[0]], columns[:, pair[1]]
        return 0.5 * (power(one + two) - power(one - two))

    size = columns.shape[1]
    rows, places = np.triu_indices(size)
    values = jax.lax.map(product, (jnp.asarray(rows), jnp.asarray(places)))
    products = jnp.zeros((size, size)).at[rows, places].set(values).at[places, rows].set(values)
    return products[:-1, :-1], products[:-1, -1]


def estimate(noise, record, blocks):
    """Shift (P,) of the constants' estimates from the truth, and their sds, to first order."""
    reduced = reduce_test(*record, blocks=blocks)
    posterior = Posterior(MODEL, noise, batch([reduced]))
    theta = truth(posterior)
    fisher, score = information(posterior, theta)
    covariance = np.linalg.inv(fisher)
    to_constants = np.asarray(constant_slopes(posterior, theta))
    spread = np.sqrt(np.diag(to_constants @ covariance @ to_constants.T))
    return to_constants @ covariance @ np.asarray(score), spread


@pytest.mark.parametrize("rate", [1.0, 20.0])
@pytest.mark.parametrize("kind", NOISE)
@pytest.mark.few(1)
def test_blocks_say_as_much_as_every_sample(record, kind, rate):
    """Sds grow by less than a tenth, and nothing but chance moves the means.

    The record has no noise, so what moves the means here is the reduction alone (blocks, two nodes,
    a coarser grid), with the encoder's steps, which both have.
    """
    shift, spread = estimate(NOISE[kind], record(rate), blocks=True)
    full_shift, full_spread = estimate(NOISE[kind], record(rate), blocks=False)
    assert np.all(np.abs(shift - full_shift) < 0.1 * full_spread)
    assert np.all(spread < 1.1 * full_spread)
    assert np.all(spread > 0.999 * full_spread)


def test_noise_moves_the_means_no_more_than_the_lost_information_allows(record):
    """The estimate from all samples is efficient: the other differs by the sds' growth."""
    test, trajectory, phases = record(20.0)
    rng = np.random.default_rng(17)
    for kind, noise in NOISE.items():
        noisy = with_force(test, test.force + NOISES[kind].draw(test.time, rng))
        shift, spread = estimate(noise, (noisy, trajectory, phases), blocks=True)
        full_shift, full_spread = estimate(noise, (noisy, trajectory, phases), blocks=False)
        chance = np.sqrt(spread**2 - full_spread**2)
        # 0.1 sd of reduction error, and 4.5 sds of chance
        assert np.all(np.abs(shift - full_shift) < 0.1 * full_spread + 4.5 * chance)
