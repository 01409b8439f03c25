"""Programs in words and tables, and what a posterior says of them."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from support.savedfit import draws, saved
from support.stepped import relative

from qlvbayes import InputError, Model, Motion, displacement_from_force, predict_program
from qlvbayes.io.units import PAD, STRAIN, UnitSystem
from qlvbayes.laws import Exponential, Prony
from qlvbayes.model.choices import Choices
from qlvbayes.plots import figure_of, plot_prediction
from qlvbayes.use.prescribed.program import parse, read_table

CREEP = "force 0.5 N in 0.1 s, hold 30 s"


def at(program, *times):
    return np.interp(times, program.time, program.value)


def test_a_program_in_words_is_the_motion_that_it_says_in_the_units_of_the_fit():
    found = parse("ramp 1.6 mm at 20 mm/s, hold 30 s, ramp to 800 um in 2 s", PAD)
    assert found.quantity == "displacement"
    assert (found.time[0], found.value[0]) == (0.0, 0.0)
    assert np.allclose(at(found, 0.04, 0.08, 30.08, 31.08, 32.08), [0.8, 1.6, 1.6, 1.2, 0.8])
    assert found.time[-1] == pytest.approx(32.08)
    assert np.all(np.diff(found.time) >= 0.0)
    assert found.longest_rest == pytest.approx(30.0)
    # slopes just after each point are those of the lines
    moving = np.diff(found.time) > 0.0
    slopes = np.diff(found.value)[moving] / np.diff(found.time)[moving]
    assert np.allclose(found.rate[:-1][moving], slopes, atol=1e-9)
    found = parse("ramp 1 mm in 1 s; sine 0.1 mm 2 Hz 3 cycles", PAD)
    time = np.linspace(1.0, 2.5, 1000)
    exact = 1.0 + 0.1 * np.sin(4.0 * np.pi * (time - 1.0))
    # chords of 96 pieces: pi^2/2/96^2 of the amplitude
    assert np.max(np.abs(at(found, *time) - exact)) < 0.1 * 5.4e-4
    assert found.time[-1] == pytest.approx(2.5)
    cell = UnitSystem("um", "nN")
    assert parse("ramp 0.001 mm at 1 um/s", cell).value[-1] == pytest.approx(1.0)
    assert parse("force 2 uN in 1 s", cell).value[-1] == pytest.approx(2000.0)
    stretched = parse("ramp 0.1 strain at 0.05 strain/s", STRAIN)
    assert (stretched.value[-1], stretched.time[-1]) == (0.1, pytest.approx(2.0))
    assert parse("force 1 MPa in 1 s", STRAIN).value[-1] == pytest.approx(1000.0)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("raamp 1 mm at 3 mm/s", ("'raamp'", "ramp")),
        ("ramp 1 furlong in 2 s", ("'furlong'", "use mm, um, nm, m, N, mN, uN or nN")),
        ("ramp 1 mm at 2 mm", ("'mm'", "mm/s, um/s, nm/s or m/s")),
        ("ramp 1 mm on 2 s", ("'on'", "at or in")),
        ("hold long", ("'long'", "number")),
        ("hold 3", ("'hold 3'", "'ramp 1.6 mm at 20 mm/s'")),
        ("force 1 mm in 1 s", ("'mm'", "use N, mN, uN or nN")),
        ("ramp 1 mm in 1 s, force 1 N in 1 s", ("the force", "the displacement")),
        ("ramp 1 mm in 1 s hold 3 s", ("'hold'", "comma")),
        ("ramp 0 mm in 1 s", ("'ramp 0 mm in 1 s'", "hold")),
        ("ramp 1 mm at -1 mm/s", ("a speed of -1", "above 0")),
        ("sine 1 mm 1 Hz 1e6 cycles", ("96000000", "50000")),
        ("hold 3 s", ("write",)),
        (" , ", ("write",)),
    ],
)
def test_what_is_not_understood_is_named_with_the_remedy(text, words):
    with pytest.raises(InputError) as refused:
        parse(text, PAD)
    assert all(word in str(refused.value) for word in words)


def test_a_table_is_read_in_its_own_units(tmp_path):
    path = tmp_path / "my.csv"
    path.write_text("time_ms,displacement_um,note\n0,0,\n500,800,x\n2000,800,\n")
    found = read_table(path, PAD)
    assert np.allclose(found.time, [0.0, 0.5, 2.0])
    assert np.allclose(found.value, [0.0, 0.8, 0.8])
    assert np.allclose(found.rate, [1.6, 0.0, 0.0])
    path.write_text("force_mN;time_s\n0,0;0\n500,5;1,5\n")
    assert read_table(path, PAD).value[-1] == pytest.approx(0.5005)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("time_s,displacement_mm\n0,0\n1,x\n", 3),
        ("time_s,displacement_mm\n0,0\n1\n", 3),
        ("time_s,displacement_mm\n0,0\n1,1\n0.9,2\n", 4),
        ("time_s,displacement_mm\n0,0\n1,1\n1,2\n1,3\n", 5),
        ("time_s,displacement_mm,force_N\n0,0,0\n", 1),
        ("time_s,weight_kg\n0,0\n", 1),
        ("time_s,force_N\n0,0\n", None),
        ("", None),
    ],
)
def test_a_table_that_cannot_be_used_is_refused_with_its_line(text, line, tmp_path):
    path = tmp_path / "my.csv"
    path.write_text(text)
    with pytest.raises(InputError) as refused:
        read_table(path, PAD)
    assert (refused.value.file, refused.value.line) == (str(path), line)
    assert refused.value.remedy


def one_model(given, place):
    c = np.array([given[f"c[{k}]"][place] for k in range(3)])
    v = np.array([given["v[1]"][place], given["v[2]"][place]])
    return Model(Exponential(given["m"][place], given["b"][place]), Prony(c, v))


def test_the_force_of_a_motion_is_the_models():
    given = draws()
    found = predict_program(given, "ramp 1.6 mm at 20 mm/s, hold 5 s, ramp 0 mm in 1 s", draws=3)
    time = np.linspace(0.0, found.time[-1], 5000)
    place = np.interp(time, found.time, found.given)
    motion = Motion(*map(jnp.asarray, (time, place, 0.0 * time, 0.0 * time)))
    for answer, k in zip(found.answers, (0, 99, 199), strict=True):
        force = np.asarray(one_model(given, k).force(motion))
        assert relative(np.interp(time, found.time, answer), force) < 1e-3


def test_creep_is_that_of_a_much_finer_grid(tmp_path):
    """In words or in a table of three rows: to 1e-4 of the displacement."""
    given, table = draws(), tmp_path / "my.csv"
    table.write_text("time_s,force_N\n0,0\n0.1,0.5\n30.1,0.5\n")
    fine = np.concatenate([np.linspace(0.0, 0.1, 201), 0.1 + np.geomspace(1e-5, 30.0, 1200)])
    load = np.interp(fine, [0.0, 0.1], [0.0, 0.5])
    exact = np.asarray(displacement_from_force(one_model(given, 0), fine, load))
    for program in (CREEP, table):
        found = predict_program(given, program, draws=2)
        assert relative(np.interp(found.time, fine, exact), found.answers[0]) < 1e-4


def test_bands_hold_their_share_of_the_draws_and_effects_of_the_fit_take_part():
    found = predict_program(draws(), CREEP)
    assert len(found.answers) == 200
    for share in (0.5, 0.9):
        low, high = found.band(share)
        inside = np.mean((found.answers > low) & (found.answers < high), axis=0)
        assert np.allclose(inside[1:], share, atol=0.011)  # an end lies between two draws
    plain, drag = (predict_program(x, "ramp 1 mm in 1 s") for x in (saved(), WITH_DRAG))
    assert np.median(drag.answers[:, 1] - plain.answers[:, 1]) == pytest.approx(0.05, rel=0.1)
    assert drag.effects == ("viscous_drag",)


WITH_DRAG = saved(**{"viscous_drag.eta": 0.05})


@pytest.mark.parametrize(
    ("program", "expected"),
    [
        ("ramp 1.6 mm at 20 mm/s, hold 30 s", ()),
        ("ramp 2.5 mm at 20 mm/s", ("depth reaches 2.5 mm, beyond the 1.6",)),
        ("ramp 1 mm at 100 mm/s", ("speed reaches 100 mm/s, outside the 0.1 to 40",)),
        ("ramp 1 mm at 0.01 mm/s", ("speed reaches 0.01 mm/s",)),
        ("ramp 1 mm in 1 s, hold 10 min", ("holds for 600 s, longer than the 30 s",)),
        ("force 1 N in 0.1 s, hold 100 s", ("depth reaches 2", "holds for 100 s")),
    ],
)
def test_leaving_the_tested_range_is_told(program, expected):
    found = predict_program(saved(), program, draws=20)
    assert len(found.warnings) == len(expected)
    for warning, words in zip(found.warnings, expected, strict=True):
        assert words in warning


def test_what_a_program_cannot_show_is_told_or_refused():
    drifting = saved(**{"force_drift.rate": 1e-3})
    found = predict_program(drifting, "ramp 1 mm in 1 s", draws=20)
    assert "force_drift goes with the clock" in found.warnings[0]
    with pytest.raises(InputError, match="inertia: straight lines have no acceleration"):
        predict_program(saved(**{"inertia.mass": 1e-3}), CREEP)
    unsure = replace(saved(), converged=False, covered=None)
    warnings = predict_program(unsure, "ramp 1 mm in 1 s", draws=20).warnings
    assert ["converge" in warnings[0], "not known" in warnings[1]] == [True, True]


def test_the_figure_shows_the_program_and_its_bands():
    found = predict_program(saved(), CREEP, draws=20)
    axes = plot_prediction(found, width=180.0)
    assert len(axes) == 4
    shown = [axis.get_ylabel() for axis in axes if axis.get_ylabel()]
    assert shown == ["force (N)", "displacement (mm)"]
    assert len(figure_of(axes).legends[0].get_texts()) == 3
    below = axes[len(axes) // 2]
    assert np.array_equal(below.lines[0].get_ydata(), found.median)


def test_a_free_curve_of_stiffness_stands_over_the_depth_of_its_tests():
    given = draws()
    names = tuple(name for name in given if name not in "mb")
    knots = np.linspace(0.3, 1.2, 7)
    columns = [given[name] for name in names] + [np.full(200, k) for k in knots]
    fit = replace(
        saved(),
        names=(*names, *(f"k{j}" for j in range(7))),
        constants=np.stack(columns, axis=-1)[None],
        choices=Choices(elastic="spline", noise="white"),
    )
    found = predict_program(fit, "ramp 1.6 mm in 1e-6 s", draws=2)
    # at once to the full depth: the area under the stiffness
    assert np.allclose(found.answers[:, -1], 0.75 * 1.6, rtol=1e-5)
    with pytest.raises(InputError, match="does not say how deep its tests went"):
        predict_program(replace(fit, covered=None), "ramp 1.6 mm in 1 s")


def test_two_rows_of_one_time_are_a_jump_and_a_load_put_on_at_once_creeps(tmp_path):
    """No speed is felt in it, and nothing flows: the limit of ever quicker ramps."""
    path = tmp_path / "jump.csv"
    path.write_text("time_s,displacement_mm\n0,0\n0,0.5\n2,0.5\n2,1\n4,1\n")
    read = read_table(path, PAD)
    assert read.time.tolist() == [0.0, 0.0, 2.0, 2.0, 4.0]
    assert read.rate.tolist() == [0.0] * 5
    jumped = predict_program(saved(), path, draws=20)
    path.write_text("time_s,displacement_mm\n0,0\n1e-9,0.5\n2,0.5\n2.000000001,1\n4,1\n")
    ramped = predict_program(saved(), path, draws=20)
    assert np.allclose(jumped.answers, ramped.answers, rtol=1e-7, atol=1e-9)
    assert "it jumps at 0 s, and the quickest ramp" in " ".join(jumped.warnings)
    path = tmp_path / "load.csv"
    path.write_text("time_s,force_N\n0,0\n1,0\n1,1\n5,1\n")
    found = predict_program(saved(), path, draws=20)
    at = np.flatnonzero(found.time == 1.0)
    assert found.given[at].tolist() == [0.0, 1.0]
    assert np.all(found.answers[:, at[0]] == 0.0)
    assert np.all(found.answers[:, at[1]] > 0.1)
    assert np.all(np.diff(found.answers[:, at[1] :], axis=1) >= 0.0)
