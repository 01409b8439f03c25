"""Check that bad readings are found, reported and left out; the other channel stays."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter
from support.solids import kinds, made_ready, solid

from qlvbayes.io.checks import InputError
from qlvbayes.io.data import Test, read_measurements
from qlvbayes.motion.clean import sound_tests
from qlvbayes.motion.outliers import outlying

SHARED = Path(__file__).parents[3] / "shared"  # measurements of others
TIME = np.arange(4000) * 0.01
HOLD, RAMP, END = 1000, 80, TIME.size - 1
STROKE = np.interp(TIME, [0.2, 1.8, 25.0, 26.6], [0.0, 1.6, 1.6, 0.0])
HALF = np.interp(TIME, [0.2, 1.8, 25.0, 25.8], [0.0, 1.6, 1.6, 0.8])


def relaxing(time, depth):
    """Force of a pad of one Prony mode that leaves a quarter of 2 N/mm e^0.5d, exact by steps."""
    return solid(time, 4.0 * np.expm1(0.5 * depth), 0.25, 0.75, 2.5)


def noise(size, seed=0):
    rng, keep = np.random.default_rng(seed), np.exp(-0.01 / 0.5)
    kicks = 0.006 * np.sqrt(1.0 - keep**2) * rng.normal(size=size)
    return 0.004 * rng.normal(size=size) + lfilter([1.0], [1.0, -keep], kicks)


def recorded(time, depth, force=None, seed=0, encoder=0.001, name="1mm/s"):
    read = np.round(depth / encoder) * encoder + 0.0
    true = relaxing(time, depth) if force is None else force
    return Test(name, "P", time, read, true + noise(time.size, seed))


def pressed(**options):
    """To 1.6 mm at 1 mm/s, held, back to 0.8 mm after 25 s, held."""
    return recorded(TIME, HALF, **options)


def spoiled(test, channel, places, values):
    column = getattr(test, channel).copy()
    column[places] = values
    return replace(test, **{channel: column})


def left_out(test):
    """Rows of the readings that are bad, and for what reasons."""
    ((_, reasons),) = sound_tests([test])
    rows = np.flatnonzero(reasons != "").tolist()
    return rows, set(reasons[rows])


NONE = [], set()


SPOILED = {
    "lost amid a hold": ("displacement", [HOLD], 0.0, "lost"),
    "lost amid a ramp": ("displacement", [RAMP], 0.0, "lost"),
    "two in a row": ("displacement", [HOLD, HOLD + 1], 0.0, "lost"),
    "twelve in a row": ("displacement", list(range(HOLD, HOLD + 12)), 0.0, "lost"),
    "a sound one between": ("displacement", [HOLD, HOLD + 2], 0.0, "lost"),
    "at the end": ("displacement", [END], 0.0, "lost"),
    "too deep": ("displacement", [HOLD], 2.4, "spike"),
    "force lost amid a hold": ("force", [HOLD], 0.0, "lost"),
    "force lost amid a ramp": ("force", [RAMP + 40], 0.0, "lost"),
    "spike": ("force", [HOLD], 9.99, "spike"),
    "spike amid a ramp": ("force", [RAMP + 20], 9.99, "spike"),
    "small spike in correlated noise": ("force", [HOLD], 1.9, "spike"),
    "three of several sizes": ("force", [HOLD, HOLD + 1, HOLD + 2], [3.0, 5.0, 6.0], "spike"),
    "both ways": ("force", [HOLD, HOLD + 1], [5.0, -5.0], "spike"),
    "force that sticks": ("force", list(range(HOLD + 1, HOLD + 20)), None, "stuck"),
    "motion that sticks": ("displacement", list(range(RAMP + 1, RAMP + 9)), None, "stuck"),
}


@pytest.mark.parametrize(("channel", "places", "values", "kind"), SPOILED.values(), ids=SPOILED)
def test_a_reading_that_both_sides_and_the_other_channel_contradict_is_left_out(
    channel, places, values, kind
):
    sound = pressed()
    if values is None:
        values = getattr(sound, channel)[places[0] - 1]
    assert left_out(spoiled(sound, channel, places, values)) == (places, {f"{kind} {channel}"})


def test_the_first_reading_of_a_record_that_begins_amid_a_hold_and_its_clock_stays():
    depth = np.interp(TIME, [25.0, 25.8], [1.6, 0.8])
    held = recorded(TIME, depth, force=depth * (0.6 + 0.3 * np.exp(-0.1 * TIME)))
    test = replace(spoiled(held, "displacement", [0], 0.0), start_s=100.0)
    assert left_out(test)[0] == [0]
    ((kept, _),) = sound_tests([test])
    assert kept.start_s + kept.time[-1] - kept.time[0] == pytest.approx(100.0 + TIME[-1])


@pytest.mark.parametrize("encoder", [0.001, 0.005, 0.02])
@pytest.mark.parametrize("after", [0.12, 0.5, 1.5, 8.0])
@pytest.mark.few(4)
def test_a_lost_reading_does_not_end_a_dwell(encoder, after):
    """The platen rests at 0.8 mm from 25.8 s on: its motion did not stick until that reading."""
    lost = round((25.8 + after) / 0.01)
    assert left_out(spoiled(pressed(encoder=encoder), "displacement", [lost], 0.0))[0] == [lost]


def test_a_cell_that_was_not_zeroed_rests_out_of_contact():
    """Its lowest force repeats from where the platen has left the pad, at which there is none."""
    test = pressed()
    force = relaxing(TIME, test.displacement)
    left = force - 1.2 * force[-1]  # the pad lets go on the way back
    rests = np.where(left > 0.0, left + noise(TIME.size, 1), 0.0) - 0.1 * np.ptp(force)
    assert left_out(replace(test, force=rests)) == NONE


def test_a_force_that_is_clipped():
    test = pressed()
    clipped = np.minimum(test.force, 0.95 * test.force.max())
    rows = np.flatnonzero(clipped == clipped.max()).tolist()
    assert left_out(replace(test, force=clipped)) == (rows, {"clipped force"})


def test_outliers_in_a_sine():
    depth = 0.8 - 0.8 * np.cos(np.pi * TIME)
    test = recorded(TIME, depth)
    for place in (150, 1111, 2040, 3333):
        size = 0.5 * np.ptp(test.force)
        assert left_out(spoiled(test, "force", [place], test.force[place] + size))[0] == [place]


TURNING = 1.6 * np.abs((TIME / 0.06 + 1.0) % 2.0 - 1.0)  # three readings a stroke


def torn(time, depth):
    return np.where(time > 12.0, 0.3, 1.0) * relaxing(time, depth)


def snapped(time, depth):
    """It breaks, and the load cell rings."""
    after = (time - 12.0).clip(0.0)
    ringing = 0.8 * np.exp(-after / 0.05) * np.cos(2.0 * np.pi * after / 0.031) * (time > 12.0)
    return np.where(time > 12.0, 0.0, relaxing(time, depth)) + ringing


def slipping(time, depth):
    """Stick and slip of a tenth of the force, every half a second."""
    return relaxing(time, depth) * (1.0 - 0.1 * (time / 0.5 % 1.0))


def rubbing(time, depth):
    speed = np.gradient(depth, time)
    return relaxing(time, depth) + 0.3 * np.sign(speed) * (np.abs(speed) > 1e-3)


def inert(time, depth):
    """A mass that shows in single readings where the speed changes."""
    return relaxing(time, depth) + 0.3 * np.gradient(np.gradient(depth, time), time) * 0.01


def attracted(time, depth):
    """It jumps into contact, and pulls until it lets go."""
    pulls = np.where((depth > 0.4) & (depth < 0.45), -0.5, 0.0)
    return relaxing(time, (depth - 0.4).clip(0.0)) + pulls


FAST = np.interp(TIME, [0.205, 0.221, 25.002, 25.018], [0.0, 1.6, 1.6, 0.0])
SLOW = np.sort(np.concatenate([[0.0], np.geomspace(0.2, 40.0, 90)]))
SOUND = {
    "a fast ramp": (TIME, FAST, relaxing),
    "a tear": (TIME, STROKE, torn),
    "a snap": (TIME, STROKE, snapped),
    "stick and slip": (TIME, STROKE, slipping),
    "a step of friction": (TIME, STROKE, rubbing),
    "inertia": (TIME, STROKE, inert),
    "inertia of a fast ramp": (TIME, FAST, inert),
    "first contact": (TIME, STROKE, attracted),
    "sparse cycles": (TIME, TURNING, relaxing),
    "a hundred points a test": (SLOW, np.interp(SLOW, [0.2, 0.4], [0.0, 1.6]), relaxing),
    "a tap": (TIME, STROKE - 0.8 * ((TIME > 9.995) & (TIME < 10.005)), relaxing),
    "pulses": (TIME, 1.6 * (TIME % 2.0 > 1.0), relaxing),
}


@pytest.mark.parametrize(("time", "depth", "law"), SOUND.values(), ids=SOUND)
@pytest.mark.parametrize("seed", range(5))
@pytest.mark.few(12)
def test_what_the_specimen_does_stays(time, depth, law, seed):
    assert left_out(recorded(time, depth, force=law(time, depth), seed=seed)) == NONE


COARSE = [(0.001, 0.0), (0.05, 0.0), (0.001, 0.05), (0.0002, 0.01)]  # steps of both channels


@pytest.mark.parametrize("every", [1, 7, 40], ids=lambda every: f"every {every}th")
@pytest.mark.parametrize(("encoder", "step"), COARSE)
@pytest.mark.few(4)
def test_coarse_steps_and_thinned_records_stay(every, encoder, step):
    for seed in range(3):
        test = pressed(seed=seed, encoder=encoder)
        force = np.round(test.force / step) * step if step else test.force
        rows = slice(None, None, every)
        kept = test.time[rows], test.displacement[rows], force[rows]
        assert left_out(replace(test, time=kept[0], displacement=kept[1], force=kept[2])) == NONE


@pytest.mark.parametrize("folder", ["real", "away", "records"])
@pytest.mark.few(1)
def test_of_measurements_only_what_was_lost_is_left_out(folder):
    if not (SHARED / folder).is_dir():
        pytest.skip(f"shared/{folder} is not here")
    for file in sorted((SHARED / folder).glob("*.csv")):
        try:
            pads = read_measurements(file).pads
        except InputError:
            continue
        every = [why for pad in pads for _, why in sound_tests(pad.tests)]
        bad = sum(np.count_nonzero(why != "") for why in every)
        assert bad == (3 if file.stem == "dropouts" else 0), file


def test_the_clock_slips_in_single_readings():
    repeated = spoiled(pressed(), "time", [700], TIME[699])
    ahead = spoiled(repeated, "time", [1500], 100.0)
    every = spoiled(ahead, "time", [2000], 3.0)
    assert left_out(every) == ([700, 1500, 2000], {"clock time"})
    ((test, _),) = sound_tests([ahead])
    assert np.all(np.diff(test.time) > 0.0)
    with pytest.raises(InputError, match=r"clock slips at 6.99 s .* delete its row"):
        sound_tests([repeated], keep_all=True)


def written(folder, test):
    rows = zip(test.time, test.displacement, test.force, strict=True)
    file = folder / "pads.csv"
    lines = [f"{t:.4f},{d:.4f},{f:.5f}" for t, d, f in rows]
    file.write_text("\n".join(["time_s,displacement_mm,force_N", *lines]) + "\n")
    return file


def test_a_file_whose_clock_slips_once_is_read_and_a_coarse_clock_is_not(tmp_path):
    once = spoiled(pressed(), "time", [700], TIME[699])
    pad = read_measurements(written(tmp_path, once)).pads[0]
    assert left_out(pad.tests[0])[0] == [700]
    coarse = replace(once, time=np.round(TIME, 1))
    with pytest.raises(InputError, match="time_s repeats"):
        read_measurements(written(tmp_path, coarse))


def test_too_many_are_refused_by_name():
    places = np.arange(500, 3900, 34)
    many = spoiled(pressed(), "displacement", places, 0.0)
    with pytest.raises(
        InputError, match=rf"{places.size} of 4000 readings of test 1mm/s of pad P .*--keep-all"
    ):
        sound_tests([many])
    ((kept, reasons),) = sound_tests([many], keep_all=True)
    assert kept is many
    assert not np.any(reasons != "")


def test_a_trial_has_neither_the_reading_nor_its_trace():
    sound, bad = pressed(), spoiled(pressed(), "displacement", [HOLD], 0.0)
    (trial,) = made_ready(bad).trials
    assert trial.left_out.time.tolist() == [TIME[HOLD]]
    assert TIME[HOLD] not in trial.test.time
    assert kinds(trial.phases) == kinds(made_ready(sound).trials[0].phases)
    worse = spoiled(bad, "force", [700, 1200, 3100], [9.99, 0.0, -7.0])
    every, floor = (made_ready(test, keep_all_readings=True) for test in (worse, sound))
    assert every.trials[0].left_out is None
    assert every.floor.total == pytest.approx(floor.floor.total, rel=0.15)  # robust by itself


def test_sound_noise_has_no_outliers():
    """So that a floor measured without them is the one measured before."""
    for seed in range(10):
        force = 1.0 + 0.5 * np.exp(-0.3 * TIME) + noise(TIME.size, seed)
        assert not outlying(TIME, force).any()
