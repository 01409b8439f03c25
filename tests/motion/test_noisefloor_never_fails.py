"""The noise floor of any dwells at all is finite and not negative, whatever its prior says."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import butter, lfilter
from support.records import Record

from qlvbayes.motion.noisefloor import measure
from qlvbayes.motion.noisefloor.floor import Dwells
from qlvbayes.motion.noisefloor.pool import Dwell, Pool
from qlvbayes.motion.phases import Phase

SIZES = st.floats(-12.0, 3.0).map(lambda power: 10.0**power)
FEW = st.integers(1, 5)
READINGS = st.one_of(FEW, st.integers(20, 60), st.sampled_from([240, 241, 1000]))
NOISES = {
    "white": lambda z: z,
    "walking": np.cumsum,
    "low-passed": lambda z: lfilter(*butter(2, 0.1), z),
    "exactly repeated": np.zeros_like,
    "alternating": lambda z: (np.arange(z.size) % 2).astype(float),
    "rounded": np.round,
    "one reading off": lambda z: np.where(np.arange(z.size) == z.size // 2, 1.0, 0.0),
}
SPACINGS = {
    "even": lambda u: np.ones(u.size),
    "hardly uneven": lambda u: 1.0 + 1e-6 * u,
    "in bursts": lambda u: np.where(u < 0.8, 1e-4, 1.0),
    "of all sizes": lambda u: 10.0 ** (-9.0 * u),
}


@st.composite
def dwells(draw):
    """A record that rests, perhaps after a ramp of about the least memory that it can show."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    count = draw(READINGS)
    gaps = SPACINGS[draw(st.sampled_from([*SPACINGS]))](rng.random(count))
    time = np.cumsum(gaps * 10.0 ** draw(st.floats(-4.0, 2.0)))
    noise = NOISES[draw(st.sampled_from([*NOISES]))](rng.normal(size=count))
    force = draw(st.sampled_from([0.0, 1.0])) + draw(SIZES) * noise
    shortest = 3.0 * float(np.quantile(np.diff(time, prepend=0.0), 0.1))
    ramp = shortest * draw(st.sampled_from([0.5, 1.0, 1.0 + 1e-12, 1.03, 5.0]))
    rests = Phase("hold", 0.0, float(time[-1])), Phase("recovery", time[-1], time[-1])
    sd = None if draw(st.booleans()) else rng.random(count) + 1e-3
    record = Record(time, force, sd, np.ones(count))
    return record, (Phase("ramp", -ramp, 0.0), *rests)


@settings(max_examples=30, deadline=None)
@given(st.lists(dwells(), min_size=1, max_size=4), st.sampled_from([0.0, 1e-3]))
def test_every_floor_is_finite_and_not_negative(tests, of_a_step):
    records, phases = zip(*tests, strict=True)
    floor = measure(records, phases, of_a_step=of_a_step)
    floors, weights = floor.weighted(40)
    for one in (floor, floor.expected(), *floor.draws(40), *floors):
        numbers = np.array([one.white, one.ou, one.tau, one.total, one.growth, one.level])
        assert np.isfinite(numbers).all()
        assert numbers.min() >= 0.0
        assert one.total > 0.0
    assert weights.sum() == pytest.approx(1.0)
    assert 1.0 <= floor.factor("tau") <= 5.0


@pytest.mark.parametrize("width", [1e-15, 1e-6, 0.028, 0.3])
def test_a_memory_whose_range_is_next_to_nothing_is_that_point(width):
    """As from 0.3000 to 0.3085 s; the other constants stay open."""
    rng = np.random.default_rng(3)
    time = np.linspace(0.1, 6.0, 60)
    force = lfilter([1.0], [1.0, -0.7], rng.normal(size=60))
    pool = Pool.from_dwells([Dwell(time, force, np.ones(60), np.arange(60))], 2.0)
    low, high = np.log(0.3), np.log(0.3) + width
    bounds = np.array([[-9.0, low], [9.2, high]])
    best = pool.likelihood(1.0, high)[0]
    posterior = Dwells(pool, best, 1.0, high, bounds, np.log(0.01), correlated=True)
    noises, weights = posterior.chosen(40, 0.5)
    white, correlated, tau = noises.T
    assert tau.min() >= 0.3 * (1.0 - 1e-9)
    assert tau.max() <= np.exp(high) * (1.0 + 1e-9)
    assert np.ptp(correlated / white) > 0.1
    assert weights.sum() == pytest.approx(1.0)
