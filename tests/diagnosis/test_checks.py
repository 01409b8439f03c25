"""Checks of a diagnosis: errors of samples, contacts, strengths, structure that is left."""

from dataclasses import replace

import numpy as np
import pytest
from blind.study import measured
from numpy.polynomial import legendre
from support.hidden_pads import FEW, hidden_pad

from qlvbayes.diagnosis.candidate import candidate_at
from qlvbayes.diagnosis.checks.samples import HeldOut, Samples, error, rmse
from qlvbayes.diagnosis.checks.structure import StructuredPart, adequacy, sized, structured
from qlvbayes.diagnosis.checks.support import (
    agreement,
    decisive,
    fewest,
    log_densities,
    pooled,
    strengths,
)
from qlvbayes.diagnosis.diagnose import diagnose
from qlvbayes.diagnosis.searchsetup import build_search
from qlvbayes.diagnosis.settings import DiagnosisSettings, Imitation
from qlvbayes.effects.catalogue import find
from qlvbayes.inference.amplitude_prior import log_noticeable
from qlvbayes.inference.errors.discrepancy import TOLERANCE
from qlvbayes.inference.forward.hypothesis import Hypothesis
from qlvbayes.inference.modes import find_mode, find_modes
from qlvbayes.io.checks import InputError
from qlvbayes.io.data import Pad, Test
from qlvbayes.io.units import PAD
from qlvbayes.motion.experiment import Experiment, prepare
from qlvbayes.priors import HalfNormal
from qlvbayes.simulate import HIDDEN, NOISES, TABLE_1, HiddenPad, paper_protocol, record_study
from qlvbayes.simulate.hidden import ViscousDrag


def test_errors_of_samples_are_weighted_by_their_sds():
    residuals = [np.array([3.0, -4.0]), np.array([0.0])]
    assert rmse(residuals) == pytest.approx(np.sqrt(25.0 / 3.0))
    good, bad = 0.1, 50.0
    expected = np.sqrt((good**2 + bad**2 / 100.0) / 1.01)
    assert rmse([np.array([good, bad])], [np.array([1.0, 10.0])]) == pytest.approx(expected)
    some, sds = [np.array([1.0, 9.0]), np.array([2.0])], [np.array([1.0, 1e6]), np.ones(1)]
    parts = [HeldOut(*both, np.ones(1)) for both in zip(some, sds, strict=True)]
    assert error(parts) == pytest.approx(np.sqrt(2.5))


OFF = (0.03, -0.02, 0.02)  # mm, of a stroke of 2 mm


def shifted(contact_sd: float | None) -> Experiment:
    """A pad with nothing hidden, whose tests have zeros that are off."""
    known = hidden_pad(rates=(1.0, 5.0, 20.0))
    tests = tuple(
        replace(trial.test, displacement=trial.test.displacement + off, contact_sd=contact_sd)
        for trial, off in zip(known.trials, OFF, strict=True)
    )
    return prepare(Pad(known.pad, tests, known.units))


def fitted(experiment: Experiment) -> tuple[float, tuple[float, ...], float]:
    """Return the plain model's p-value, the scatter that it needs, and its error over the noise."""
    search = build_search(experiment, kinds=FEW)
    search.evaluate(search.baseline)
    point = search.candidates[search.baseline].point
    record = search.density.space.record
    tested = adequacy(experiment, record, point, search.settings.cells)
    model = point.own.model_at(point.constants)
    samples = Samples.from_experiment(experiment, search.density.space, model)
    left = samples.residuals(search.density, search.candidates[search.baseline].mode)
    return tested.p_value, point.separation.scatter.sizes, rmse(left) / experiment.floor.total


def test_a_known_error_of_the_zeros_explains_what_they_leave():
    """Without it the stiffness would have to differ from test to test."""
    _, scatter, error_left = fitted(shifted(None))
    assert any(scatter)
    assert error_left > 1.5
    p_value, scatter, error_left = fitted(shifted(0.02))
    assert p_value > 0.05
    assert not any(scatter)
    assert error_left == pytest.approx(1.0, abs=0.1)


def test_errors_of_contacts_are_those_of_the_law_that_is_found():
    """A spring with the force 2 d^1.5 (N), whose one contact for all tests is off by an error."""
    rng, tests = np.random.default_rng(2), []
    for speed in (0.1, 0.3, 1.0):
        time = np.arange(0.0, 4.0 / speed + 5.0, 0.01)
        way = np.interp(time, [0.0, 1.0, 1.0 + 3.0 / speed], [-1.0, -1.0, 2.0])
        force = 2.0 * np.maximum(way, 0.0) ** 1.5 + 0.01 * rng.standard_normal(time.size)
        tests.append(
            Test(
                name=f"{speed:g}", pad="p", time=time, displacement=np.round(way + 0.05, 4),
                force=force, role="validate", contact_sd=0.05, contact_stage="one",
            )
        )  # fmt: skip
    search = build_search(prepare(Pad("p", tuple(tests), PAD)), kinds=())
    search.begin()
    hertz = Hypothesis("hertz", "prony:2")
    search.evaluate(hertz, search.baseline)
    before = search.candidates[hertz]
    search._move_about()
    after = search.candidates[hertz]
    assert search.about is None
    assert set(search.candidates) == {search.baseline, hertz}
    assert after.mode.loss < before.mode.loss - 10.0
    power = after.point.own.names.index("n")
    assert abs(after.point.constants[power] - 1.5) < 0.005
    assert abs(before.point.constants[power] - 1.5) > 0.02


RATES = (5.0, 10.0, 20.0, 40.0)  # mm/s
DRAG = Hypothesis("exponential", "prony:2", frozenset({"viscous_drag"}))


def test_a_drag_of_many_strengths_is_told_test_by_test():
    """One test at each rate, each with a drag of its own (N s/mm)."""
    tests, etas = [], (0.012, 0.002, 0.010, 0.004)
    for k, (eta, rate) in enumerate(zip(etas, RATES, strict=True)):
        (trial,) = hidden_pad(HIDDEN["viscous_drag"](eta=eta), rates=(rate,), seed=k).trials
        tests.append(replace(trial.test, start_s=400.0 * k))
    experiment = prepare(Pad("B", tuple(tests), PAD))
    search = build_search(experiment, kinds=FEW)
    density, space = search.density, search.density.space
    mode = find_mode(density, DRAG, np.median(space.prior_draws(DRAG), axis=0))
    found = candidate_at(density, DRAG, mode, search.settings.tolerance)
    samples = Samples.from_experiment(experiment, space)
    many = strengths(density, samples, found, "viscous_drag", Imitation())
    assert many.spread > 0.2
    assert many.agreement < 0.95
    low, high = many.range
    assert high > 1.5 * low
    assert [part.test for part in many.parts] == [trial.name for trial in experiment.trials]


def test_strengths_are_pooled_about_their_mean_and_agree_by_the_force_that_one_makes():
    """A common factor is the amplitude's, not a scatter."""
    for deviations, share in (([0.0, 0.0], 1.0), ([1.0, -1.0], 0.5), ([3.0, -3.0], 0.1)):
        assert agreement(np.ones(2), np.array(deviations)) == pytest.approx(share)
    curvature, squares = np.eye(6) / 0.05**2, np.ones(6)
    scatter = np.array([0.3, -0.2, 0.1, -0.3, 0.2, -0.1])
    moved, sds, spread = pooled(curvature, curvature @ (scatter + 2.0), squares, Imitation())
    assert moved == pytest.approx(scatter, abs=0.05)
    assert np.all(sds < 0.06)
    assert 0.1 < spread < 0.5
    same, _, none = pooled(curvature, curvature @ np.full(6, 2.0), squares, Imitation())
    assert none == 0.0
    assert np.all(same == 0.0)


@pytest.mark.parametrize(
    ("gains", "count"), [([1.0], 1), ([3.0, 1.0, 1.0], 1), ([1.0] * 6, 3), ([4.0, 3.0, -2.0], 1)]
)
def test_no_smaller_set_carries_half(gains, count):
    assert fewest(np.array(gains)) == count


@pytest.fixture(scope="module")
def searched():
    """A pad with drag, seen without it and with it, and a lag of next to nothing."""
    experiment = hidden_pad(ViscousDrag(eta=0.004), rates=(1.0, 20.0))
    search = build_search(experiment, kinds=[find("viscous_drag")])
    search.begin()
    with_drag = search.baseline.plus("viscous_drag")
    theta = search.density.space.parameters(with_drag)
    start = np.zeros(theta.size)
    point = search.modes[search.baseline][0].point
    start[theta.positions_of(point.own)] = point.theta
    start[-1] = 0.1
    found = find_modes(search.density, with_drag, start)
    search.keep(with_drag, search.candidates_from(with_drag, found))
    return experiment, search, with_drag


def test_the_block_means_log_densities_add_up_to_the_likelihood(searched):
    _, search, with_drag = searched
    density = search.density
    found = search.modes[with_drag][0]
    terms = density.terms(found.point, found.mode.size)
    constant = 0.5 * np.log(density.whitener.precisions / (2.0 * np.pi)).sum()
    expected = constant - (terms.loss - found.point.prior.loss)
    assert log_densities(density, found).sum() == pytest.approx(float(expected), rel=1e-9)


def test_a_drag_is_carried_by_many_and_one_reading_is_told_as_one(searched):
    experiment, search, with_drag = searched
    density = search.density
    found, without = search.modes[with_drag][0], search.modes[search.baseline][0]
    drag = decisive(density, experiment.trials, found, without)
    assert drag.blocks > 4  # of two coarsely sampled tests
    assert drag.phase in ("ramp", "unload")
    assert drag.of == density.whitener.precisions.size
    # the same fits, of a record in which one reading alone is off the plain model
    spiked = found.point.predicted.copy()
    test, block = 1, 40
    spiked[test, block] -= 1.0
    other = replace(found, mode=replace(found.mode, size=0.0))
    alone = replace(other, mode=replace(other.mode, point=replace(found.point, predicted=spiked)))
    one = decisive(density, experiment.trials, other, alone)
    assert one.blocks == 1
    assert one.test == experiment.trials[test].name
    assert decisive(density, experiment.trials, alone, other) is None


ROWS = 60
TIME = np.geomspace(1e-2, 10.0, ROWS)
WHITE, OU, TAU = 0.01, 0.006, 0.7
COVARIANCE = WHITE**2 * np.eye(ROWS) + OU**2 * np.exp(-np.abs(TIME[:, None] - TIME) / TAU)
ROOT = np.linalg.cholesky(COVARIANCE)
SHAPES = {
    "offset": np.ones(ROWS),
    "bend": legendre.legval(np.linspace(-1.0, 1.0, ROWS), [0.3, 0.0, 1.0, 0.5]),
}


def draws(shape, rms, count=800, seed=3):
    """Sizes found in residuals that hold a curve of this root mean square."""
    rng = np.random.default_rng(seed)
    curve = SHAPES[shape] * rms / np.sqrt(np.mean(SHAPES[shape] ** 2))
    noise = (ROOT @ rng.standard_normal((ROWS, count))).T
    return np.array([structured(curve + one, COVARIANCE, 4, 0.05) for one in noise])


def test_structure_is_found_without_bias_below_its_bound_and_noise_has_no_size_beyond_chance():
    """The bound holds in 19 of 20; of noise alone nothing is found in about half of all cells."""
    rms, upper, _ = draws("bend", 0.03).T
    found, true = rms**2, 0.03**2
    assert abs(found.mean() - true) < 4.0 * found.std() / np.sqrt(found.size)
    assert np.mean(upper >= 0.03) > 0.95 - 4.0 * np.sqrt(0.05 * 0.95 / upper.size)
    rms, upper, bias = draws("offset", 0.0).T
    assert 0.3 < np.mean(rms == 0.0) < 0.8
    assert np.mean(rms**2) < np.mean(COVARIANCE)  # that of the mean, the largest part
    assert np.all(upper >= rms)
    assert abs(bias.mean()) < 4.0 * bias.std() / np.sqrt(bias.size)
    residual = 0.05 * SHAPES["bend"] + ROOT @ np.random.default_rng(1).standard_normal(ROWS)
    one = structured(residual, COVARIANCE, 4, 0.05)
    thousand = structured(1e3 * residual, 1e6 * COVARIANCE, 4, 0.05)  # in mN
    np.testing.assert_allclose(thousand, 1e3 * np.array(one), rtol=1e-6)


def left(upper, shown=True, **changes):
    return replace(
        StructuredPart("B-1", "ramp", 0.0, 50, 0.8 * upper, upper, 0.5 * upper, shown), **changes
    )


def remaining(*cells, excess=0.0, tolerance=0.01):
    return sized(cells, 0.1, excess, 2.0, tolerance)


def test_what_is_surely_below_the_tolerance_is_small_and_effects_have_the_same():
    assert remaining(left(0.019), left(0.010)).small
    assert not remaining(left(0.019), left(0.021)).small
    assert remaining(left(0.019), left(0.5, shown=False)).small  # a wide bound shows nothing
    assert not remaining(left(0.019), excess=0.021).small  # what no smooth curve sees
    assert not remaining(left(0.019), tolerance=0.0).small
    assert remaining(left(0.021), tolerance=0.02).small
    large = left(0.01, test="B-9", phase="hold")
    cell = remaining(left(0.005), large, left(0.5, shown=False)).record
    assert (cell.test, cell.phase) == ("B-9", "hold")
    assert cell.share_of_peak == pytest.approx(0.008 / 2.0)
    assert cell.small
    prior = HalfNormal(0.1)
    assert log_noticeable(prior, 0.03, 0.01) == log_noticeable(prior, 0.03, 0.01, TOLERANCE)
    assert DiagnosisSettings().tolerance == TOLERANCE
    by_tolerance = [log_noticeable(prior, 0.03, 0.01, x) for x in (0.0, 0.01, 0.05)]
    assert by_tolerance[0] == 0.0
    assert by_tolerance[2] < by_tolerance[1]  # 1.5 % of the peak: less than 5 %


@pytest.mark.parametrize("share", [-0.01, 0.5, 1.0, np.nan])
def test_a_tolerance_that_is_no_small_share_is_refused(share):
    with pytest.raises(InputError, match="tolerance"):
        DiagnosisSettings(tolerance=share)


@pytest.fixture(scope="module")
def rippled():
    """A pad with a ripple over depth of 0.5 % of its peak force, which no listed effect has."""
    noise = NOISES["correlated"]
    quiet = replace(noise, white=0.5 * noise.white, correlated=0.5 * noise.correlated)
    programs = {f"{rate:g}": paper_protocol(rate) for rate in (0.1, 1.0, 20.0, 100.0)}
    pad = measured(record_study({"B": HiddenPad(TABLE_1["B"])}, programs, quiet, 0, 1000), "B")
    tests = [
        replace(t, force=t.force + 0.007 * np.sin(2.0 * np.pi * t.displacement / 0.8))
        for t in pad.tests
    ]
    return diagnose(prepare(replace(pad, tests=tuple(tests))), kinds=FEW)


@pytest.mark.slow
def test_structure_that_is_sure_but_small_does_not_make_a_pad_unexplained(rippled):
    assert rippled.result.stages[-1].p_value < DiagnosisSettings().false_alarms
    assert rippled.result.verdict == "adequate"
    left = rippled.result.remainder
    assert left.sure
    assert left.small
    assert 0.0 < left.rms < 0.007  # the smooth part of the ripple
    peak = rippled.work.experiment.scales.force
    assert max(left.upper95, left.excess) > 1e-3 * peak  # a tenth of the tolerance it is not below
