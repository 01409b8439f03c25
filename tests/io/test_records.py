"""Records of kinds on which something went wrong: our own of each, and those kept elsewhere."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.endtoend import call
from support.machine_files import Pressed, bluehill, pressed, workbook
from support.solids import solid

from qlvbayes.comparison.side import Side, unheld_times
from qlvbayes.fitting.optimum import find_start
from qlvbayes.io.checks import InputError
from qlvbayes.io.contact import find_contact, is_dead
from qlvbayes.io.conversion import convert
from qlvbayes.io.data import Pad, Test, read_measurements
from qlvbayes.io.loading import Answers, pattern_of
from qlvbayes.io.naming import pad_in, suggested_pattern
from qlvbayes.io.units import PAD, UnitSystem
from qlvbayes.model.choices import Choices
from qlvbayes.motion.experiment import prepare
from qlvbayes.motion.facts import Covered
from qlvbayes.motion.pad import cut

SHARED = Path(__file__).parents[3] / "shared" / "records"  # made by others


def shared(name):
    path = SHARED / name
    if not path.exists():
        pytest.skip(f"{name} is not here")
    return path


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


@pytest.mark.parametrize("rows", [[], [["Specimen", "Operator", "Width"], ["silicone A", "x", 3]]])
def test_a_sheet_of_keys_and_values_names_the_specimen_of_the_others(tmp_path, rows):
    """But no table of results."""
    pytest.importorskip("python_calamine")
    form = [["Report"], ["Specimen", "silicone A"], ["Operator", "x"], *rows]
    path = workbook(tmp_path / "a.xlsx", ["v1", "v2"], form=form)
    pads = {test.pad for test in convert([path]).tests}
    assert pads == ({"pad"} if rows else {"silicone A"})


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


def side(name, rates, hold, quickest=0.5):
    draws = {"m": 1.0, "b": 0.5, "c[0]": 0.4, "c[1]": 0.3, "c[2]": 0.3}
    draws |= {f"v[{k}]": v for k, v in enumerate(rates, 1)}
    table = np.array([list(draws.values())] * 20)
    reach = Covered(1.0, 1.0, 2.0, quickest, hold, 1)
    return Side(name, tuple(draws), table, Choices(), PAD, reach)


def test_times_that_a_test_does_not_hold_are_told():
    long, short = side("long", (1.0, 0.03), 180.0), side("short", (2.0, 0.3), 7.0)
    (notice,) = unheld_times([long, short])
    assert notice == "1/v[2] of long is 33 s, and short was held for 7 s"
    assert not unheld_times([side("a", (1.0, 0.3), 180.0), short])  # both hold all times
    assert not unheld_times([long, side("b", (1.0, 0.03), 170.0)])
    quick = side("quick", (100.0, 0.3), 7.0, quickest=0.05)
    assert "the quickest ramp of short took" in unheld_times([quick, short])[0]


@pytest.mark.slow
def test_one_material_held_long_and_short_is_not_called_different(tmp_path):
    """180 s and 7 s of one record, of a material of three times."""
    time = np.arange(0.0, 190.0, 0.1)
    way = np.minimum(time / 12.0, 0.75)
    elastic = 5.0 / 0.2 * np.expm1(0.2 * way)
    load = 0.4 * elastic + sum(solid(time, elastic, 0.0, 0.2, tau) for tau in (0.5, 5.0, 50.0))
    force = load + 0.004 * np.random.default_rng(3).standard_normal(time.size)
    rows = ["pad,test,time_s,displacement_mm,force_N"]
    for pad, last in (("long", 190.0), ("short", 16.0)):
        kept = time < last
        rows += [
            f"{pad},1,{t:.2f},{d:.5f},{f:.5f}"
            for t, d, f in zip(time[kept], way[kept], force[kept], strict=True)
        ]
    path = tmp_path / "two.csv"
    path.write_text("\n".join(rows) + "\n")
    assert call("fit", path, "-o", tmp_path / "out", "--max-steps", "3000")[0] == 0
    status, out, _ = call("compare", tmp_path / "out", "--json")
    (found,) = json.loads(out)
    assert status == 0
    assert found["differ"] is not True
    assert not [c for c in found["contrasts"] if c["group"] == "constants"]
    assert found["omnibus"]["over"] == "shown"


def pulled():
    time = np.arange(0.0, 40.0, 0.1)
    return Pad("strip", (Test("pull", "strip", time, 1.0 * time, np.sqrt(time)),), PAD)


def test_a_part_of_a_test_is_used_and_told():
    pad, notices = cut(pulled(), ["pull:0..18mm"])
    (test,) = pad.tests
    assert (test.time[0], test.displacement[-1]) == (0.0, pytest.approx(18.0))
    told = "181 rows are used, as stated by pull:0..18mm, and 219 left out"
    assert notices == (f"pad strip: of test pull {told}",)
    (late,) = cut(pulled(), ["strip/pull:5..9 s"])[0].tests
    assert (late.time[0], late.displacement[0], late.start_s) == (0.0, 5.0, 5.0)
    assert cut(pulled(), [])[1] == ()
    with pytest.raises(InputError, match="leaves fewer than 10 rows"):
        cut(pulled(), ["pull:0..0.5mm"])
    with pytest.raises(InputError, match="is no part of a test"):
        cut(pulled(), ["pull 0 to 18"])


def test_a_fit_heeds_the_error_of_contact():
    """A zero that is 0.01 mm off moves m by far more than readings alone say, not than both do."""
    test, found = pressed(approach=0.0, seed=2), {}
    for off, sd in ((0.0, None), (0.01, None), (0.01, 0.01)):
        one = Test("a", "P", test.time, test.way + off, test.load, contact_sd=sd)
        experiment = prepare(Pad("P", (one,), PAD))
        normal = find_start(experiment, Choices(modes=1), experiment.trials).normal
        found[off, sd] = normal.mean[0], float(np.sqrt(normal.covariance[0, 0]))
    true = found[0.0, None][0]
    assert found[0.01, 0.01][1] > 1.5 * found[0.0, None][1]
    assert abs(found[0.01, None][0] - true) > 4.0 * found[0.01, None][1]
    assert abs(found[0.01, 0.01][0] - true) < 2.0 * found[0.01, 0.01][1]


@pytest.mark.parametrize("seed", range(2))
def test_noise_that_ends_at_once_is_known_where_it_is(seed):
    """A step of stress of 0.06 held for 60 s, under noise of 3, 0.1 and 0.001 one after another."""
    time = np.geomspace(0.01, 60.0, 150)
    strain = np.minimum(time / 0.09, 1.0) * 1e-3
    true = np.select([time < 0.3, time < 3.0], [3.0, 0.1], 0.001)
    stress = 60.0 * strain + true * np.random.default_rng(seed).standard_normal(time.size)
    units = UnitSystem("1", "Pa")
    experiment = prepare(Pad("gel", (Test("r", "gel", time, strain, stress),), units))
    (trial,) = experiment.trials
    found = trial.test.force_sd
    steps = np.searchsorted(time, [0.3, 3.0])
    # windows of 21 readings that hold no step; a third are independent: 2.5 is three sds and more
    away = np.all(np.abs(np.arange(time.size)[:, None] - steps) > 12, axis=1)
    assert np.all(np.abs(np.log(found / true))[away] < np.log(2.5))
    assert 0.05 < experiment.peak < 0.5  # and not the 8 of the largest noise
    late = time > 3.5
    weights = 1.0 / found[late] ** 2
    assert weights @ stress[late] / weights.sum() == pytest.approx(0.06, rel=0.01)


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
