"""Errors of speed and acceleration in ramp-ups of few readings, against motions known exactly."""

import numpy as np
import pytest
from support.motions import constant_jerk, read, sampled, sine, trapezoids

from qlvbayes.motion import patherrors
from qlvbayes.motion.patherrors import path_errors
from qlvbayes.motion.trajectory import smooth

FORCE_NOISE = 0.02  # of the peak force of inertia: sd of one reading
STEP = 3e-4  # mm


def there_and_back(rng, interval):
    """Jerk-limited strokes, at a random phase of the logger's clock."""
    speed, limit, rise = np.exp(rng.uniform(*np.log([[3.0, 200.0, 0.005], [50.0, 2000.0, 0.05]])))
    top = min(limit, speed / rise)
    flat, jerk = max(speed / top - rise, 1e-9), top / rise
    steady = max(0.1, 2.0 / speed)
    rows = [(0.5 + rng.uniform(0.0, interval), 0.0, 0.0, 0.0)]
    for sign in (1.0, -1.0):
        for turn in (sign, -sign):
            rows += [(rise, turn * jerk, 0.0, None), (flat, 0.0, turn * top, None)]
            rows.append((rise, -turn * jerk, turn * top, None))
            if turn == sign:
                rows.append((steady, 0.0, 0.0, sign * speed))
        rows.append((0.7, 0.0, 0.0, 0.0))
    return constant_jerk(rows, 3)


def errors_of(motion, interval, step=STEP):
    t = sampled(motion, interval)
    x, v, a = motion.at(t)
    x = x if step == 0.0 else read(x, step)[0]
    path = smooth(t, x, step)
    return t, path_errors(t, x, path, t), (v - path.velocity(t), a - path.acceleration(t)), (v, a)


@pytest.mark.parametrize("interval", [0.01, 0.03])
@pytest.mark.few(1)
def test_the_force_of_a_known_mass_is_off_by_as_much_as_is_stated(interval):
    """Chi squared is that of the readings, within a factor of two; else over ten times that."""
    rng = np.random.default_rng(4)
    squares, alone, count, states = 0.0, 0.0, 0, []
    for _ in range(4):
        _, errors, (_, off), (_, a) = errors_of(there_and_back(rng, interval), interval)
        noise = FORCE_NOISE * np.abs(a).max()
        used = np.any(errors.acceleration != 0.0, axis=0)
        rows = errors.acceleration[:, used]
        left = off[used] + noise * rng.normal(size=used.sum())
        covariance = rows.T @ rows + noise**2 * np.eye(used.sum())
        squares += left @ np.linalg.solve(covariance, left)
        alone += left @ left / noise**2
        count += used.sum()
        assert np.abs(off[~used]).max() < 3.0 * noise
        states.append(np.sqrt(np.mean(rows**2) * len(rows)) / np.sqrt(np.mean(off[used] ** 2)))
    assert 0.25 < squares / count < 2.0
    assert alone / count > 10.0
    assert 0.8 < np.median(states) < 2.0


@pytest.mark.slow
def test_the_speed_is_off_by_as_much_as_is_stated():
    rng = np.random.default_rng(5)
    squares = []
    for _ in range(5):
        _, errors, (off, _), _ = errors_of(there_and_back(rng, 0.01), 0.01)
        sd = np.sqrt(np.sum(errors.velocity**2, axis=0))
        squares.append(np.mean(off[sd > 0.0] ** 2) / np.mean(sd[sd > 0.0] ** 2))
    assert 0.2 < np.mean(squares) < 1.5


def test_what_is_too_much_at_the_beginning_of_a_ramp_up_is_too_little_at_its_end():
    """The change of speed is known: an error of the speed comes and goes within the ramp-up."""
    motion = there_and_back(np.random.default_rng(6), 0.01)
    t = sampled(motion, 0.01)
    x = read(motion.at(t)[0], STEP)[0]
    errors = path_errors(t, x, smooth(t, x, STEP), sampled(motion, 0.001))
    large = np.abs(errors.acceleration).max(axis=1) > 0.2 * np.abs(errors.acceleration).max()
    assert np.count_nonzero(large) >= 4
    for speed, rate in zip(errors.velocity[large], errors.acceleration[large], strict=True):
        assert rate.min() < 0.0 < rate.max()
        inside = np.flatnonzero(rate)
        assert np.abs(speed[inside[[0, -1]]]).max() < 0.3 * np.abs(speed).max()


def test_each_ramp_up_has_errors_of_its_own():
    motion = there_and_back(np.random.default_rng(7), 0.01)
    t, errors, _, _ = errors_of(motion, 0.01)
    seen = [t[np.flatnonzero(row)] for row in errors.acceleration]
    assert max(np.ptp(times) for times in seen) < 0.4  # s: there are 0.7 s between strokes
    assert min(times.min() for times in seen) > 0.4  # the platen rests before


def test_what_readings_resolve_has_next_to_no_error():
    """Slow changes of acceleration, read a hundred times in each."""
    t, errors, _, (_, a) = errors_of(sine(1.0, 3), 0.001, step=0.0)
    middle = (t > 0.2) & (t < 2.8)
    sd = np.sqrt(np.sum(errors.acceleration**2, axis=0))
    assert sd[middle].max(initial=0.0) < 0.02 * np.abs(a).max()


def test_a_fit_through_kinks_knows_that_its_acceleration_is_wrong():
    """Straight lines have none; the readings show that there is one."""
    motion = trapezoids(20.0, lead=0.1)
    t = sampled(motion, 0.01)
    x, _, a = motion.at(t)
    errors = path_errors(t, x, smooth(t[::2], x[::2]), t)
    off = np.abs(a - smooth(t[::2], x[::2]).acceleration(t))
    sd = np.sqrt(np.sum(errors.acceleration**2, axis=0))
    assert np.all(sd[off > 0.5 * off.max()] > 0.2 * off.max())


def test_the_rest_of_a_stretch_in_which_nothing_changes_has_no_errors(monkeypatch):
    """A long stretch is cut into short ones, of which the last may lie in the rest after it."""
    monkeypatch.setattr(patherrors, "_LONGEST", 5)
    for length in (6, 12, 20):
        rise = 0.002 * length
        rows = [(0.3, 0.0, 0.0, 0.0), (rise, 20.0 / rise**2, 0.0, None), (0.1, 0.0, 0.0, 20.0),
                (rise, -20.0 / rise**2, 0.0, None), (0.3, 0.0, 0.0, 0.0)]  # fmt: skip
        _, found, *_ = errors_of(constant_jerk(rows, 3), 0.002, 1e-4)
        assert np.isfinite(found.velocity).all()
        assert np.isfinite(found.acceleration).all()
