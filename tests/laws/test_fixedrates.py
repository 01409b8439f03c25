"""A long spectrum as few modes of fixed rates, over the times of a record."""

import numpy as np
import pytest

from qlvbayes.inference.forward.fixedrates import FixedRates
from qlvbayes.laws.relaxation.continuous import Fung, LogNormalSpectrum, PowerLaw

SHORTEST, LONGEST = 1e-3, 60.0  # s


@pytest.fixture(scope="module")
def fixed():
    dense = np.geomspace(SHORTEST, LONGEST, 400)
    time = np.concatenate([np.arange(0.0, 0.05, SHORTEST), dense[dense > 0.06]])
    return FixedRates.over(time[None])


@pytest.mark.parametrize(
    "law",
    [Fung(0.8, 0.01, 30.0), LogNormalSpectrum(0.3, 1.0, 2.0), PowerLaw(0.1, 0.4, 0.5)],
    ids=lambda law: law.name,
)
def test_few_modes_relax_as_many_do(fixed, law):
    fractions, rates = (np.asarray(x)[None] for x in law.spectrum())
    few = fixed.fractions(fractions, rates)[0]
    assert fixed.rates.size < rates.size
    time = np.append(0.0, np.geomspace(SHORTEST, LONGEST, 500))
    whole = fractions[0, 0] + fractions[0, 1:] @ np.exp(-np.outer(rates[0], time))
    reduced = few[0] + few[1:] @ np.exp(-np.outer(fixed.rates, time))
    np.testing.assert_allclose(reduced, whole, atol=5e-5)
    assert few.sum() == pytest.approx(1.0, abs=1e-5)  # the step of a sudden start


def test_records_of_like_times_share_their_rates(fixed):
    alike = FixedRates.over(np.linspace(0.0, 1.05 * LONGEST, 60_000)[None])
    np.testing.assert_array_equal(alike.rates, fixed.rates)
