"""The size of structure that is left: unbiased, bounded, and what it changes of a verdict."""

from dataclasses import replace

import numpy as np
import pytest
from blind.study import measured
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial import legendre
from support.hidden_pads import FEW

from qlvbayes.diagnosis.checks.structure import StructuredPart, sized, structured
from qlvbayes.diagnosis.diagnose import diagnose
from qlvbayes.diagnosis.settings import DiagnosisSettings
from qlvbayes.inference.amplitude_prior import log_noticeable
from qlvbayes.inference.errors.discrepancy import TOLERANCE
from qlvbayes.io.checks import InputError
from qlvbayes.motion.experiment import prepare
from qlvbayes.priors import HalfNormal
from qlvbayes.simulate import NOISES, TABLE_1, HiddenPad, paper_protocol, record_study

ROWS = 60
TIME = np.geomspace(1e-2, 10.0, ROWS)
WHITE, OU, TAU = 0.01, 0.006, 0.7
COVARIANCE = WHITE**2 * np.eye(ROWS) + OU**2 * np.exp(-np.abs(TIME[:, None] - TIME) / TAU)
ROOT = np.linalg.cholesky(COVARIANCE)
SHAPES = {
    "offset": np.ones(ROWS),
    "slope": np.linspace(-1.0, 1.0, ROWS),
    "bend": legendre.legval(np.linspace(-1.0, 1.0, ROWS), [0.3, 0.0, 1.0, 0.5]),
}


def draws(shape, rms, count=2000, seed=3):
    """Sizes found in residuals that hold a curve of this root mean square."""
    rng = np.random.default_rng(seed)
    curve = SHAPES[shape] * rms / np.sqrt(np.mean(SHAPES[shape] ** 2))
    noise = (ROOT @ rng.standard_normal((ROWS, count))).T
    return np.array([structured(curve + one, COVARIANCE, 4, 0.05) for one in noise])


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.few(2)
def test_a_clear_structure_is_found_without_bias_and_below_its_bound_in_19_of_20(shape):
    rms, upper, _ = draws(shape, 0.03).T
    found, true = rms**2, 0.03**2
    assert abs(found.mean() - true) < 4.0 * found.std() / np.sqrt(found.size)
    assert np.mean(upper >= 0.03) > 0.95 - 4.0 * np.sqrt(0.05 * 0.95 / upper.size)


def test_noise_alone_has_no_size_beyond_chance():
    """The structured part is at most what noise makes, and nothing in about half of all cells."""
    rms, upper, bias = draws("offset", 0.0).T
    assert 0.3 < np.mean(rms == 0.0) < 0.8
    assert np.mean(rms**2) < np.mean(COVARIANCE)  # that of the mean, the largest part
    assert np.all(upper >= rms)
    assert abs(bias.mean()) < 4.0 * bias.std() / np.sqrt(bias.size)


@given(st.floats(0.01, 100.0))
def test_sizes_follow_the_unit_of_the_force(factor):
    residual = 0.05 * SHAPES["bend"] + ROOT @ np.random.default_rng(1).standard_normal(ROWS)
    one = structured(residual, COVARIANCE, 4, 0.05)
    other = structured(factor * residual, factor**2 * COVARIANCE, 4, 0.05)
    np.testing.assert_allclose(other, factor * np.array(one), rtol=1e-6)


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
