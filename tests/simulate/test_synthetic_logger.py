"""The logger keeps few rows, and the ones that carry the information."""

import numpy as np
import pytest

from qlvbayes.io.checks import InputError
from qlvbayes.simulate import PAPER_RATES, Hold, Move, Platen, encode, paper_protocol, thin


def sampled(program):
    platen = Platen(program)
    time = np.arange(int(platen.duration * 1000) + 1) / 1000
    return platen, time, encode(platen.displacement(time))


@pytest.mark.parametrize("max_rows", [40, 100, 500, 5000])
@pytest.mark.parametrize("rate", PAPER_RATES)
def test_rows_are_few_ascending_and_include_both_ends(rate, max_rows):
    _, time, displacement = sampled(paper_protocol(rate))
    kept = thin(time, displacement, max_rows)
    assert 0.8 * max_rows < kept.size <= max_rows
    assert kept[0] == 0
    assert kept[-1] == time.size - 1
    assert np.all(np.diff(kept) > 0)


@pytest.mark.parametrize("rate", PAPER_RATES)
def test_each_hold_has_consecutive_samples_long_after_the_stop(rate):
    platen, time, displacement = sampled(paper_protocol(rate))
    kept = thin(time, displacement, 500)
    for stop in platen.kinks[[-5, -1]]:
        late = kept[(time[kept] > stop + 2) & (time[kept] < stop + 29)]
        assert np.sum(np.diff(late) == 1) >= 10


@pytest.mark.parametrize("rate", PAPER_RATES)
def test_intervals_grow_in_proportion_to_the_time_since_the_stop(rate):
    platen, time, displacement = sampled(paper_protocol(rate))
    kept = thin(time, displacement, 500)
    stop = platen.kinks[-5]
    hold = time[kept][(time[kept] >= stop) & (time[kept] <= stop + 30)] - stop
    assert np.all(np.diff(hold) < 0.1 * (hold[:-1] + 0.02) + 0.001)  # and a sample of rounding
    assert hold[0] < 0.01
    assert hold[-1] > 27
    ramp = displacement[kept][time[kept] <= stop]
    assert np.abs(np.diff(ramp)).max() < 0.041  # 1 ms at 40 mm/s, the least there is


def test_a_record_without_holds_or_without_motion_is_thinned_too():
    _, time, displacement = sampled((Move(1.0, 0.5), Move(0.0, 0.5), Move(1.6, 1.0)))
    assert 80 < thin(time, displacement, 100).size <= 100
    _, time, displacement = sampled((Hold(10.0),))
    assert 80 < thin(time, displacement, 100).size <= 100


def test_too_few_rows_are_refused():
    _, time, displacement = sampled(paper_protocol(1.0))
    with pytest.raises(InputError, match="keep at least 33"):
        thin(time, displacement, 32)
