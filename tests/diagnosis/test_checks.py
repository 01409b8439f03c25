"""Checks of a diagnosis: errors of samples, contact, strengths in each test, decisive readings."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.hidden_pads import FEW, hidden_pad

from qlvbayes.diagnosis.candidate import candidate_at
from qlvbayes.diagnosis.checks.samples import HeldOut, Samples, error, rmse
from qlvbayes.diagnosis.checks.structure import adequacy
from qlvbayes.diagnosis.checks.support import (
    agreement,
    decisive,
    fewest,
    log_densities,
    pooled,
    strengths,
)
from qlvbayes.diagnosis.searchsetup import build_search
from qlvbayes.diagnosis.settings import Imitation
from qlvbayes.effects.catalogue import find
from qlvbayes.inference.forward.hypothesis import Hypothesis
from qlvbayes.inference.modes import find_mode, find_modes
from qlvbayes.io.data import Pad, Test
from qlvbayes.io.units import PAD
from qlvbayes.motion.experiment import Experiment, prepare
from qlvbayes.motion.record import batch
from qlvbayes.simulate import HIDDEN
from qlvbayes.simulate.hidden import ViscousDrag


def test_errors_of_samples_are_weighted_by_their_sds():
    residuals = [np.array([3.0, -4.0]), np.array([0.0])]
    assert rmse(residuals) == pytest.approx(np.sqrt(25.0 / 3.0))
    equal = [np.full(2, 0.7), np.full(1, 0.7)]
    assert rmse(residuals, equal) == pytest.approx(rmse(residuals))
    good, bad = 0.1, 50.0
    expected = np.sqrt((good**2 + bad**2 / 100.0) / 1.01)
    assert rmse([np.array([good, bad])], [np.array([1.0, 10.0])]) == pytest.approx(expected)
    residuals, sds = [np.array([1.0, 9.0]), np.array([2.0])], [np.array([1.0, 1e6]), np.ones(1)]
    parts = [HeldOut(*both, np.ones(1)) for both in zip(residuals, sds, strict=True)]
    assert [error([part]) for part in parts] == pytest.approx([1.0, 2.0])
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


def found_strengths(etas):
    """One test at each rate, each with a drag of its own (N s/mm)."""
    tests = []
    for k, (eta, rate) in enumerate(zip(etas, RATES, strict=True)):
        (trial,) = hidden_pad(HIDDEN["viscous_drag"](eta=eta), rates=(rate,), seed=k).trials
        tests.append(replace(trial.test, start_s=400.0 * k))
    experiment = prepare(Pad("B", tuple(tests), PAD))
    search = build_search(experiment, kinds=FEW)
    density, space = search.density, search.density.space
    mode = find_mode(density, DRAG, np.median(space.prior_draws(DRAG), axis=0))
    found = candidate_at(density, DRAG, mode, search.settings.tolerance)
    samples = Samples.from_experiment(experiment, space)
    return strengths(density, samples, found, "viscous_drag", Imitation())


def test_a_drag_of_one_strength_agrees_and_one_of_many_strengths_is_told():
    one = found_strengths([0.004] * 4)
    assert one.agreement > 0.95
    many = found_strengths([0.012, 0.002, 0.010, 0.004])
    assert many.spread > 0.2
    assert many.agreement < one.agreement
    low, high = many.range
    assert high > 1.5 * low
    assert [part.test for part in many.parts] == [part.test for part in one.parts]


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


@given(st.lists(st.floats(-5.0, 5.0), min_size=1, max_size=8))
def test_no_smaller_set_carries_half(values):
    gains = np.array(values)
    if gains.sum() <= 0.0:
        return
    count, half = fewest(gains), 0.5 * gains.sum()
    ordered = np.sort(gains)[::-1]
    assert ordered[:count].sum() >= half - 1e-12
    assert count == 1 or ordered[: count - 1].sum() < half


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


@pytest.mark.parametrize("effects", [frozenset(), frozenset({"viscous_drag"})], ids=len)
def test_the_block_means_log_densities_add_up_to_the_likelihood(searched, effects):
    _, search, _ = searched
    density = search.density
    found = search.modes[replace(search.baseline, effects=effects)][0]
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


@pytest.mark.parametrize("elastic", ["exponential", "polynomial:2"])
def test_samples_in_parts_are_predicted_as_all_of_them_together(elastic):
    """A platen that comes through 0.8 mm of air: each part knows when it touched the pad."""
    time = np.arange(0.0, 6.0, 2e-3)
    depth = np.interp(time, [0.0, 1.0, 1.6, 4.0, 4.4, 6.0], [-0.8, -0.8, 1.6, 1.6, 0.0, 0.0])
    force = np.maximum(depth, 0.0) + 1e-3 * np.random.default_rng(0).standard_normal(time.size)
    tests = [
        Test(name=name, pad="p", time=time, displacement=depth, force=force, role="fit")
        for name in ("first", "second")
    ]
    experiment = prepare(Pad("p", tuple(tests), PAD))
    space = build_search(experiment, kinds=FEW).density.space
    hypothesis = Hypothesis(elastic, "prony:2", frozenset())
    constants = space.parameters(hypothesis).constants(space.prior_draws(hypothesis)[:3])
    samples = Samples.from_experiment(experiment, space)
    assert len(samples.parts) > 1
    records = [
        experiment.reduced(trial, rows)
        for trial, rows in zip(experiment.trials, samples.rows, strict=True)
    ]
    together = space.forces(hypothesis, constants, batch(records))
    for k, force in enumerate(samples.predict(hypothesis, constants)):
        peak = np.abs(force).max(axis=1, keepdims=True)
        assert np.all(np.abs(force - together[:, k, : force.shape[1]]) < 1e-3 * peak)
