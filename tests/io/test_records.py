"""Records of kinds on which something went wrong: our own of each, and those kept elsewhere."""

from dataclasses import replace

import numpy as np
import pytest
from support.endtoend import call
from support.machine_files import Pressed, bluehill, pressed, workbook
from support.solids import solid

from qlvbayes.io.checks import InputError
from qlvbayes.io.contact import find_contact, is_dead
from qlvbayes.io.conversion import convert
from qlvbayes.io.data import read_measurements
from qlvbayes.io.loading import Answers, pattern_of
from qlvbayes.io.naming import pad_in, suggested_pattern


def written(folder, name, test, zero=0.0):
    path = folder / f"{name}.csv"
    path.write_text(bluehill(test, zero=zero))
    return path


def rise(power, seed, *, speed=2.0, rate=200.0, noise=0.003):
    """A press of 1.2 mm whose force is a power of the depth and relaxes by a third as it rises."""
    rng = np.random.default_rng(seed)
    approach = rng.uniform(0.2, 0.8)
    time = np.arange(int(rate * ((approach + 1.2) / speed + 0.5))) / rate
    way = np.minimum(time * speed - approach, 1.2)
    load = solid(time, np.maximum(way, 0.0) ** power, 0.4, 0.6, 1.0 / 3.0)
    return way, load + noise * max(load) * rng.standard_normal(len(load))


@pytest.mark.parametrize(
    ("power", "more"),
    [*((power, {"noise": noise}) for power in (1.0, 1.5, 2.0, 2.5) for noise in (0.003, 0.03)),
     (1.5, {"speed": 20.0, "rate": 1000.0})],
)  # fmt: skip
@pytest.mark.few(3)
def test_contact_is_found_within_its_error_for_every_power(power, more):
    """In 90 % intervals 18 of 20 tests are expected; fewer than 15 have a chance of 1 %."""
    hits = 0
    for seed in range(20):
        way, load = rise(power, seed, **more)
        found = find_contact(way + 5.0, load)
        hits += found is not None and abs(found.position - 5.0) < 1.645 * found.sd
    assert hits >= 15


def test_a_dead_cell_is_named_and_the_rest_is_read(tmp_path):
    files = [
        written(tmp_path, f"p{k}", pressed(0.4, speed=speed, seed=k), 7.0)
        for k, speed in enumerate((1.0, 2.0, 3.0))
    ]
    good = pressed(0.4, seed=3)
    noise = 0.002 * np.random.default_rng(2).standard_normal(good.load.size)
    dead = written(tmp_path, "dead", Pressed(good.time, good.way, noise + 0.025), 7.0)
    out = tmp_path / "tidy.csv"
    status, _, err = call("convert", files[0], dead, *files[1:], "-o", out)
    said = err.strip().splitlines()
    assert status == 2
    assert "dead.csv: the force does not answer to the displacement" in said[-2]
    assert "1 of 4 files is left out" in said[-1]
    assert "without: qlvbayes convert" in said[-1]
    assert "dead.csv -o" not in said[-1].split("without:")[1]
    assert [test.name for test in read_measurements(out).pads[0].tests] == ["p0", "p1", "p2"]
    assert not is_dead(good.way, good.load)


def test_the_force_that_is_taken_off_is_as_uncertain_as_is_told(tmp_path):
    """Over 16 files the errors are about one standard error, also of correlated noise."""
    off = []
    for seed in range(16):
        press, rng = pressed(1.2, seed=seed), np.random.default_rng(100 + seed)
        noise = 0.003 * rng.standard_normal(press.load.size)
        for k in range(1, noise.size):
            noise[k] += 0.6 * noise[k - 1]
        load = press.load + noise + 0.3
        (test,) = convert([written(tmp_path, "a", replace(press, load=load), 7.0)]).tests
        taken = float(np.median(load[-test.force.size :] - test.force))
        off.append((taken - 0.3) / test.tare_sd)
    assert 0.6 < float(np.sqrt(np.mean(np.square(off)))) < 1.5


def test_what_is_no_pattern_of_names_is_refused_and_the_option_is_told(tmp_path, in_this_process):
    for none in ("(", "a{99999999999}", "(" * 5000):
        with pytest.raises(InputError, match="is no pattern"):
            Answers.from_words(pad_from=none)
    pytest.importorskip("python_calamine")
    path = workbook(tmp_path / "a.xlsx", ["AA1", "AA2", "BB1"])
    assert "--pad-from" in convert([path]).remarks[0]
    assert not convert([path], Answers.from_words(pads=("AA", "AA", "BB"))).remarks


@pytest.mark.parametrize(
    ("names", "pads"),
    [
        (["AA1", "AA2", "BB1"], ["AA", "AA", "BB"]),
        (["P1_slow", "P1_fast", "P2_slow"], ["P1", "P1", "P2"]),
        (["pad 1 - slow", "pad 1 - fast", "pad 2 - slow"], ["pad 1", "pad 1", "pad 2"]),
        (["Specimen 1", "Specimen 2"], ["Specimen 1", "Specimen 2"]),
    ],
)
def test_a_pattern_is_suggested_for_the_names_of_a_file(names, pads):
    pattern = pattern_of(suggested_pattern(names))
    assert [pad_in(name, pattern) for name in names] == pads


@pytest.mark.parametrize("power", [1.5, 2.0])
@pytest.mark.parametrize("speed", [1.0, 2.0, 3.0])
@pytest.mark.few(3)
def test_a_soft_rise_from_the_first_reading_on_is_no_late_contact(power, speed):
    """Of a specimen that relaxes, so that its rise looks steeper at first than later."""
    time = np.arange(0.0, 1.6 / speed + 3.0, 1.0 / 200.0)
    depth = np.round(np.minimum(speed * time, 1.6), 3)
    elastic = (depth / 1.6) ** power
    force = solid(time, elastic, 0.5, 0.3, 0.2) + solid(time, elastic, 0.0, 0.2, 3.3)
    rng = np.random.default_rng(3)
    for _ in range(15):
        noisy = force + rng.normal(0.0, 0.003, time.size)
        found = find_contact(depth, noisy, at_zero=True)
        assert found is None or abs(found.position) < 3.0 * found.sd
