"""Block averages: no sample lost, exact nodes, and as much learned as from every sample."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from qlvbayes.fitting.posterior import Predictor
from qlvbayes.inference.errors.whitening import Whitener
from qlvbayes.inference.forward.space import STEP
from qlvbayes.io.data import Test
from qlvbayes.laws.scales import Scales
from qlvbayes.model.choices import default_model
from qlvbayes.model.noise import White
from qlvbayes.motion.noisefloor import NoiseFloor
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
    "white": NoiseFloor(NOISES["white"].white, 0.0, 1.0),
    "correlated": NoiseFloor(CELL.white, CELL.correlated, CELL.correlation_time),
}


@pytest.fixture(scope="module")
def record():
    """The paper's test at 1 kHz, 61 000 samples and more, without noise; kept once made."""

    @cache
    def at(rate):
        platen = Platen(paper_protocol(rate))
        time = np.arange(int(1e3 * platen.duration)) / 1e3
        force = Pad(CONSTANTS).force(platen, time)
        test = Test("t", "B", time, encode(platen.displacement(time)), force)
        trajectory = smooth(test.time, test.displacement)
        return test, trajectory, find_phases(trajectory)

    return at


def with_force(test, force, force_sd=None):
    return Test(test.name, test.pad, test.time, test.displacement, force, force_sd)


def test_every_sample_clear_of_kinks_is_in_exactly_one_block_of_one_phase(record):
    test, trajectory, phases = record(20.0)
    noisy = with_force(test, np.random.default_rng(1).standard_normal(test.time.size))
    blocks = reduce_test(noisy, trajectory, phases).blocks
    owners = np.zeros(test.time.size, dtype=int)
    columns = (blocks.first, blocks.last, blocks.count, blocks.force)
    for first, last, count, force in zip(*columns, strict=True):
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
    for phase in phases[:-1]:
        assert not np.any((blocks.first < phase.stop) & (blocks.last > phase.stop))


def test_unreduced_samples_are_kept_as_they_are(record):
    test, trajectory, phases = record(20.0)
    kept = reduce_test(test, trajectory, phases, samples=np.arange(test.time.size))
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
    nodes = np.polyval(coefficients, reduced.motion.time)
    assert np.allclose(reduced.average(nodes), reduced.blocks.force, rtol=1e-12)


def test_blocks_are_short_where_a_thinned_record_is_dense():
    """A hundred readings, dense about the press: its peak is not averaged with what follows."""
    fine = np.arange(0.0, 0.2, 0.005)
    time = np.concatenate([fine, np.geomspace(0.2, 300.0, 60)])
    test = Test("t", "B", time, np.minimum(10.0 * time, 1.0), np.exp(-10.0 * time))
    trajectory = smooth(time, test.displacement)
    blocks = reduce_test(test, trajectory, find_phases(trajectory)).blocks
    first, last = np.asarray(blocks.first), np.asarray(blocks.last)
    hold = (first > 0.1) & (last < 1.0)
    assert hold.sum() > 8
    assert np.all((last - first)[hold] < np.maximum(0.75 * (first[hold] - 0.1), 0.016))


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


def test_a_start_from_rest_that_is_known_exactly_makes_no_reading_doubtful():
    """No speed jumps where a record begins with an acceleration."""
    time = np.arange(0.0, 1.0, 1e-2)
    trajectory = smooth(time, time**2)
    still = np.zeros_like(trajectory.start_velocity)
    exact = replace(trajectory, start_velocity=still, resolution=0.0)
    assert exact.start_acceleration[0] > 0.0
    assert clear_of_kinks(time, exact, find_phases(exact)).mean() > 0.95


def model_over(*records):
    """The model over some tests, and theta at the constants of the simulated pad."""
    predictor = Predictor.from_model(MODEL, White(1.0), batch(records))
    constants = np.array([CONSTANTS.m, CONSTANTS.b, *CONSTANTS.c, *CONSTANTS.v])
    theta = [
        np.ravel(leaf.prior.unconstrain(own if own.size > 1 else own[0]))
        for leaf in predictor.parameters.leaves
        for own in [constants[list(leaf.constants)]]
    ]
    return predictor, np.concatenate(theta)


def test_batching_changes_no_force(record):
    """Tests of different lengths, padded to one size."""
    records = [reduce_test(*record(rate)) for rate in (1.0, 20.0)]
    together, theta = model_over(*records)
    whole = together.forces(together.parameters.constants(theta[None]))[0]
    for k, single in enumerate(records):
        alone, _ = model_over(single)
        force = alone.forces(alone.parameters.constants(theta[None]))[0, 0, alone.space.real[0]]
        np.testing.assert_allclose(whole[k, together.space.real[k]], force, rtol=1e-12)


def of_samples(noise, samples, rows):
    """Whiten rows (M, 1, B) at single samples, too many for a matrix, by a Kalman filter."""
    real, time = samples.real[0], samples.first[0]
    steps, own = np.exp(-np.diff(time, prepend=time[0]) / noise.tau), rows[:, 0].T
    others = noise.white**2 + samples.extra[0] ** 2 + samples.timing[0] ** 2
    mean, variance, white = np.zeros(len(rows)), noise.ou**2, np.zeros(own.shape)
    for k in np.flatnonzero(real):
        mean, variance = steps[k] * mean, noise.ou**2 + steps[k] ** 2 * (variance - noise.ou**2)
        spread, error = variance + others[k], own[k] - mean
        white[k] = error / np.sqrt(spread)
        mean, variance = mean + variance / spread * error, variance * others[k] / spread
    return white[real].T


def estimate(noise, record, blocks):
    """Shift (P,) of the constants' estimates from the truth, and their sds, to first order."""
    predictor, theta = model_over(
        reduce_test(*record, samples=None if blocks else np.arange(record[0].time.size))
    )
    constants, force, slopes = predictor.space.forces_and_slopes(predictor.hypothesis, theta)
    steps = constants[1:, :7] - constants[0, :7]
    to_constants = (steps / (STEP * predictor.parameters.length)[:, None]).T
    rows = np.concatenate([slopes, (predictor.record.blocks.force - force)[None]])
    if blocks:
        rows = Whitener.from_floor(noise, predictor.record.blocks, 0.0)(rows)
    else:
        rows = of_samples(noise, predictor.record.blocks, rows)
    white, residual = rows[:-1], rows[-1]
    covariance = np.linalg.inv(white @ white.T)
    spread = np.sqrt(np.diag(to_constants @ covariance @ to_constants.T))
    return to_constants @ covariance @ white @ residual, spread


@pytest.mark.parametrize("rate", [1.0, 20.0])
@pytest.mark.parametrize("kind", NOISE)
@pytest.mark.few(1)
def test_blocks_say_as_much_as_every_sample(record, kind, rate):
    """Sds grow by less than a tenth; of a record without noise the reduction moves no mean."""
    shift, spread = estimate(NOISE[kind], record(rate), blocks=True)
    full_shift, full_spread = estimate(NOISE[kind], record(rate), blocks=False)
    assert np.all(np.abs(shift - full_shift) < 0.1 * full_spread)
    assert np.all(spread < 1.1 * full_spread)
    assert np.all(spread > 0.999 * full_spread)
