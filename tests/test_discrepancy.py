"""The discrepancy's noise and kernel, and that it keeps predictions of left-out tests honest."""

import jax.numpy as jnp
import numpy as np
import pytest
from endtoend import experiment
from hidden_pads import ensemble_of

from qlvbayes.data import Pad, Test
from qlvbayes.diagnosis.discrepancy import Discrepancy, fit_discrepancy
from qlvbayes.diagnosis.discrepancy.coverage import HeldOutCoverage
from qlvbayes.diagnosis.discrepancy.process import Inputs, Kernel, Residuals, fit_scales
from qlvbayes.diagnosis.samples import Samples
from qlvbayes.diagnosis.search import Path, plain_fits
from qlvbayes.diagnosis.verdict import Work
from qlvbayes.experiment import prepare
from qlvbayes.synthetic import (
    NOISES,
    TABLE_1,
    HiddenPad,
    TemperatureSwing,
    paper_protocol,
    record_study,
)
from qlvbayes.units import PAD

RATES = (1.0, 5.0, 20.0, 40.0)


def simulated(*effects):
    """Four tests of pad B with hidden effects."""
    runs = record_study(
        {"pad": HiddenPad(TABLE_1["B"], effects)},
        {f"{rate:g}": paper_protocol(rate) for rate in RATES},
        NOISES["correlated"],
        seed=5,
        max_rows=250,
    )
    tests = tuple(
        Test(
            run.name,
            run.pad,
            run.record.time,
            run.record.displacement,
            run.record.force,
            start_s=run.start_s,
        )
        for run in runs
    )
    return prepare(Pad("pad", tests, PAD))


def fitted(experiment):
    """The discrepancy of the plain model."""
    ensemble = ensemble_of(experiment)
    work = Work(experiment, ensemble, Samples.of(experiment, ensemble), Path(), ())
    return fit_discrepancy(work, plain_fits(ensemble)[0])


@pytest.fixture(scope="module")
def swinging():
    return fitted(simulated(TemperatureSwing(0.06, 52.0, -0.7)))


@pytest.fixture(scope="module")
def explained():
    return fitted(experiment())


def random_inputs(rng, count, tests):
    return Inputs(
        rng.uniform(-3.0, 3.0, count),
        rng.uniform(0.0, 1.0, count),
        rng.uniform(-1.0, 3.0, count),
        rng.uniform(0.2, 1.0, count),
        rng.integers(0, 3, count).astype(float),
        rng.integers(0, tests, count).astype(float),
    )


def test_the_kernel_is_a_covariance():
    inputs = random_inputs(np.random.default_rng(1), 60, 4)
    kernel = Kernel(jnp.log(jnp.array([0.5, 0.3, 2.0, 0.4, 2.0])))
    matrix = np.asarray(kernel(inputs, inputs))
    np.testing.assert_allclose(matrix, matrix.T)
    assert np.linalg.eigvalsh(matrix).min() > -1e-12
    size = np.asarray(inputs.size)
    np.testing.assert_allclose(np.diag(matrix), (0.25 + 0.09) * size**2)
    other_phase = inputs.phase[:, None] != inputs.phase
    assert np.all(matrix[other_phase] == 0.0)


def test_the_sizes_come_back():
    """Hyperparameters of a function drawn from the process."""
    rng = np.random.default_rng(2)
    inputs = random_inputs(rng, 300, 6)
    true = np.log([0.5, 0.1, 2.0, 0.4, 2.0])
    matrix = np.asarray(Kernel(jnp.asarray(true))(inputs, inputs))
    noise = 0.05**2 * np.eye(300)
    residual = np.linalg.cholesky(matrix + noise) @ rng.standard_normal(300)
    found = fit_scales(Residuals(inputs, residual, noise), true + 0.5)
    assert abs(found[0] - true[0]) < 0.7
    assert found[1] < found[0]
    assert np.all(np.abs(found[2:] - true[2:]) < 1.2)


def test_where_all_is_explained_it_is_small(explained):
    assert explained.sd < 0.5 * experiment().floor.total
    for band in explained.predict():
        assert np.all(np.abs(band.mean) < experiment().floor.total)


def test_what_is_not_explained_has_its_size(swinging):
    assert isinstance(swinging, Discrepancy)
    residuals = swinging.work.samples.residuals(swinging.point.constants)
    bands = swinging.predict()
    assert len(bands) == len(RATES)
    size = np.sqrt(np.mean(np.concatenate(residuals) ** 2))
    assert swinging.sd == pytest.approx(size, rel=0.4)
    floor = swinging.work.experiment.floor.total
    for band, residual in zip(bands, residuals, strict=True):
        assert band.mean.shape == band.sd.shape == residual.shape
        assert np.std(residual - band.mean) < 1.5 * floor


def test_left_out_tests_are_covered(swinging):
    coverage = swinging.held_out_coverage
    assert isinstance(coverage, HeldOutCoverage)
    assert len(coverage.honest) == len(RATES)
    assert np.mean(coverage.without) < 0.65
    assert 0.8 <= np.mean(coverage.honest) <= 0.99
    assert np.mean(coverage.honest) > np.mean(coverage.without) + 0.2
