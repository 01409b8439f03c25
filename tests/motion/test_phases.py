from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from qlvbayes.io.checks import InputError
from qlvbayes.motion.phases import find_phases, loading_rate
from qlvbayes.motion.trajectory import smooth

REAL = Path(__file__).parents[3] / "shared" / "real"
STEP = 1e-3


def record(corners, dt=1e-3, step=STEP):
    """Straight lines through (time, depth) corners, read in encoder steps."""
    times, depths = np.array(corners, dtype=float).T
    t = np.arange(times[0], times[-1] + 0.5 * dt, dt)
    return t, np.round(np.interp(t, times, depths) / step) * step


def kinds(phases):
    return [p.kind for p in phases]


def cover(phases, t):
    assert phases[0].start == pytest.approx(t[0])
    assert phases[-1].stop == pytest.approx(t[-1])
    assert all(a.stop == b.start for a, b in pairwise(phases))
    assert all(p.stop > p.start for p in phases)


def test_the_four_phases_of_a_test():
    t, x = record([(0, 0), (0.5, 0), (0.58, 1.6), (10, 1.6), (11.6, 0), (20, 0)])
    phases = find_phases(smooth(t, x))
    cover(phases, t)
    assert kinds(phases) == ["hold", "ramp", "hold", "unload", "recovery"]
    edges = [p.start for p in phases[1:]]
    assert np.allclose(edges, [0.5, 0.58, 10.0, 11.6], atol=3e-3)


@pytest.mark.parametrize("speed", [0.1, 1.0, 7.3])
def test_a_staircase_up_and_down(speed):
    corners, at, depth = [(0.0, 0.0)], 0.0, 0.0
    for sign in [1] * 5 + [-1] * 5:
        at, depth = at + 0.2 / speed, depth + 0.2 * sign
        corners += [(at, depth), (at + 3.0, depth)]
        at += 3.0
    t, x = record(corners)
    phases = find_phases(smooth(t, x))
    cover(phases, t)
    assert kinds(phases) == ["ramp", "hold"] * 5 + ["unload", "recovery"] * 5


def test_jitter_and_creep_belong_to_the_hold():
    t, x = record([(0, 0), (0.08, 1.6), (5, 1.6), (30, 1.603)])
    x[[2000, 9000, 9001]] -= STEP
    assert kinds(find_phases(smooth(t, x))) == ["ramp", "hold"]


def test_a_creeping_hold_after_unloading_is_a_recovery():
    t, x = record([(0, 0), (1, 1), (5, 1), (6, 0.5), (30, 0.495)])
    assert kinds(find_phases(smooth(t, x))) == ["ramp", "hold", "unload", "recovery"]


def test_cycles_without_rests():
    t = np.arange(0.0, 3.25, 1e-3)
    x = np.round(0.5 * (1.0 - np.cos(2 * np.pi * t)) / STEP) * STEP
    moving = [k for k in kinds(find_phases(smooth(t, x))) if k in ("ramp", "unload")]
    assert moving == ["ramp", "unload"] * 3 + ["ramp"]


def test_a_record_at_rest_is_one_hold():
    t = np.arange(0.0, 5.0, 1e-3)
    motion = smooth(t, np.full(t.size, 0.2))
    phases = find_phases(motion)
    assert kinds(phases) == ["hold"]
    with pytest.raises(InputError, match="no loading ramp"):
        loading_rate(motion, phases)


@settings(max_examples=20, deadline=None)
@given(st.floats(0.2, 50.0), st.floats(0.5, 3.0))
def test_loading_rate_is_the_speed_of_the_ramp(speed, stroke):
    t, x = record([(0, 0), (0.2, 0), (0.2 + stroke / speed, stroke), (2 + stroke / speed, stroke)])
    motion = smooth(t, x)
    assert loading_rate(motion, find_phases(motion)) == pytest.approx(speed, rel=0.02)


def real(name, depth):
    path = REAL / name
    if not path.exists():
        pytest.skip(f"{name} is not here")
    for (pad, test), rows in pd.read_csv(path).groupby(["pad", "test"], sort=False):
        t, x = rows["time_s"].to_numpy(float), rows[depth].to_numpy(float)
        motion = smooth(t, x)
        phases = find_phases(motion)
        cover(phases, t)
        yield str(pad), str(test), motion, phases


def test_measured_muscle_is_ramp_and_hold_at_its_stated_duration():
    for _, test, motion, phases in real("muscle_ramps.csv", "strain"):
        assert kinds(phases) == ["ramp", "hold"], test
        duration = float(test.rsplit("-", 1)[1].removesuffix("s"))
        assert phases[0].stop == pytest.approx(duration, rel=0.01)
        assert loading_rate(motion, phases) == pytest.approx(0.2258 / duration, rel=0.01)


def test_measured_adhesive_staircases():
    for pad, test, _, phases in real("adhesive_shear.csv", "displacement_mm"):
        if pad == "stairs":
            # The records end with the fifth ramp.
            assert kinds(phases) == ["ramp", "hold"] * 4 + ["ramp"], test
        else:
            up, down = ["ramp", "hold"] * 5, ["unload", "recovery"] * 4 + ["unload"]
            assert kinds(phases) == up + down, test
