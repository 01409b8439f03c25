"""A slope of the force off the specimen is measured, told and taken off; drags are not."""

import numpy as np
import pytest
from support.solids import solid

from qlvbayes.io.data import Pad, Test
from qlvbayes.io.units import UnitSystem
from qlvbayes.motion.approach import without_slopes

UM = UnitSystem("um", "nN")
CONTACT, NOISE, SPEED = 4.0, 0.004, 2.0  # um, nN, um/s
COURSE = ([0.0, 2.8, 6.8, 10.0], [0.0, 5.6, 5.6, -0.8])
OFF = 0.3  # um, by which a contact that was found is wrong


def a_test(along=0.0, drift=0.0, back=True, seed=0, drag=0.0, film=0.0, **kwargs):
    """A sphere that relaxes, m x^1.5 (0.6 + 0.4 e^{-2 t}), with what the air shows beside it."""
    time = np.arange(0.0, COURSE[0][-1], 0.02)
    way = np.interp(time, *COURSE)
    elastic = 0.9 * np.maximum(way - CONTACT, 0.0) ** 1.5
    velocity = np.gradient(way, time)
    force = np.maximum(solid(time, elastic, 0.6, 0.4, 0.5), 0.0) + along * way + drift * time
    force += drag * np.sign(velocity) + film * velocity / (1.0 - (way - CONTACT) / 12.0) ** 3
    force += NOISE * np.random.default_rng(seed).standard_normal(time.size)
    kept = slice(None) if back else time < 6.5
    zero = CONTACT - OFF if "contact_sd" in kwargs else CONTACT
    return Test("t", "p", time[kept], way[kept] - zero, force[kept], **kwargs)


def of(*tests):
    return without_slopes(Pad("p", tests, UM))


@pytest.mark.parametrize("back", [True, False])
@pytest.mark.parametrize("along", [0.035, -0.05, 0.1])
@pytest.mark.few(3)
def test_a_slope_is_taken_off_and_told_with_its_error(along, back):
    test, level = a_test(along, back=back), a_test(back=back)
    pad, notices = of(test)
    off = pad.tests[0].force - level.force
    assert np.ptp(off) < 0.05 * abs(along) * np.ptp(test.displacement) + 0.01
    assert np.array_equal(pad.tests[0].displacement, test.displacement)  # the file's own zero stays
    (notice,) = notices
    assert "off the specimen the force changes by" in notice
    assert ("and on the way back" in notice) is back


def test_contact_that_was_found_is_found_again():
    tests = [a_test(0.035, seed=k, contact_sd=0.5) for k in range(8)]
    off = []
    for test in tests:
        (levelled,) = of(test)[0].tests
        shift = float(test.displacement[0] - levelled.displacement[0])
        off.append((shift - OFF) / levelled.contact_sd)
        assert levelled.contact_sd < 0.15
    assert np.sqrt(np.mean(np.square(off))) < 1.8  # of 8 standard errors; 0.999 of a normal's


def test_a_drift_with_the_clock_is_one_too():
    pad, notices = of(a_test(drift=0.02))
    assert np.ptp(pad.tests[0].force - a_test().force) < 0.02
    assert "nN/s" in notices[0]


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.few(3)
def test_a_level_force_stays_as_it_was_read(seed):
    test = a_test(seed=seed, contact_sd=0.05)
    pad, notices = of(test)
    assert pad.tests[0] is test
    assert notices == ()


def touched(force, **kwargs):
    """A specimen that is pressed from the first reading on."""
    time = np.arange(0.0, 8.0, 0.02)
    way = np.minimum(time, 6.0)
    read = force(way) + NOISE * np.random.default_rng(0).standard_normal(time.size)
    return Test("t", "p", time, way, read, **kwargs)


@pytest.mark.parametrize(
    "tests",
    [
        [a_test(drag=0.05)],
        [a_test(film=0.02)],
        [a_test(0.035), a_test(seed=1), a_test(seed=2)],  # one of three is not the rig's
        *([touched(law, contact_sd=sd)] for sd in (None, 0.05) for law in (
            lambda way: 0.5 * way, lambda way: 0.4 * np.expm1(0.5 * way), lambda way: 0.2 * way**2
        )),
    ],
)  # fmt: skip
def test_what_turns_with_the_direction_or_is_the_specimens_stays(tests):
    assert of(*tests)[1] == ()
