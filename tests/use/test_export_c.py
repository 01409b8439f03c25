"""The C header: warnings, undefined behaviour, the force of the Python model, and the way back."""

import re
from itertools import product
from math import exp

import numpy as np
import pytest
from support.compiled_pad import STRICT, CompiledPad, needs_gcc
from support.endtoend import study
from support.exported_pad import ELASTIC, RELAXATION, exported, reference
from support.lawmotions import LAWS, python_force, retracting

from qlvbayes.io.checks import InputError
from qlvbayes.model.choices import Choices
from qlvbayes.use.exports.c_header import CHeader
from qlvbayes.use.exports.expressions import _PAIRS, _SINGLES
from qlvbayes.use.exports.layers import elastic_functions

pytestmark = needs_gcc
# of the largest force: what rounding a million times in another order may come to
EXACT = 1e-12


def functions(law):
    """The elastic force, stiffness, step and slope of a law, as expressions."""
    return elastic_functions(reference(Choices(elastic=law)).elastic)


def evaluated(function, constants):
    """An expression as a function of its arguments, evaluated by Python's own arithmetic."""
    work, known = function.work, _PAIRS | _SINGLES

    def value(*arguments):
        inputs = dict(zip(function.arguments, arguments, strict=True))
        values = {}
        for x in work.ordered:
            args = [values[id(y)] for y in x.args]
            if x.op == "constant":
                values[id(x)] = x.value
            elif x.op in ("constant_of", "line"):
                values[id(x)] = (constants | inputs)[x.value]
            elif x.op == "choose":
                values[id(x)] = args[1] if args[0] else args[2]
            else:
                values[id(x)] = known[x.op](*args)
        return values[id(work.force)]

    return value


def six_tests():
    """Time and displacement of pad B's six bundled tests, as they were recorded."""
    tests = study().pad("B").tests
    assert len(tests) == 6
    return [(np.asarray(test.time), np.asarray(test.displacement)) for test in tests]


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """Give a law's exported pad and its compiled header, once each."""
    known = {}

    def build(law="exponential", relaxation="prony", *, bonded=False, flags=None):
        key = law, relaxation, bonded, flags
        if key not in known:
            folder = tmp_path_factory.mktemp("c")
            pad = exported(folder, Choices(elastic=law, relaxation=relaxation, bonded=bonded))
            options = {} if flags is None else {"flags": flags}
            known[key] = pad, CompiledPad(folder / "c", CHeader().files(pad, None), **options)
        return known[key]

    return build


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.few(2)
def test_force_is_that_of_the_python_model_on_the_six_tests(compiled, law):
    pad, program = compiled(law)
    for time, depth in six_tests():
        force, _ = program.force(time, depth)
        expected = python_force(pad, time, depth)
        assert np.max(np.abs(force - expected)) <= EXACT * np.max(np.abs(expected))


@pytest.mark.parametrize("law", LAWS)
def test_displacement_brings_back_the_motion(compiled, law):
    _, program = compiled(law)
    for time, depth in six_tests():
        force, touched = program.force(time, depth)
        found, _ = program.displacement(time, force)
        # once it is left, the platen may be anywhere outside
        left = np.flatnonzero(~touched & (np.arange(time.size) > np.argmax(touched)))
        until = left[0] if left.size else time.size
        assert until > 0.5 * time.size
        pressed = np.arange(time.size) >= np.argmax(touched)
        assert np.max(np.abs(found - depth)[:until][pressed[:until]]) <= 1e-12


@pytest.mark.parametrize("bonded", [False, True])
def test_contact_is_lost_and_found_as_in_the_python_model(compiled, bonded):
    pad, program = compiled(bonded=bonded)
    time, depth = retracting()
    force, touched = program.force(time, depth)
    expected = python_force(pad, time, depth)
    assert np.max(np.abs(force - expected)) <= EXACT * np.max(np.abs(expected))
    assert (np.min(expected) < 0.0) == bonded
    assert np.array_equal(touched, (expected > 0.0) | bonded)


def test_a_glued_specimen_comes_back_from_pulling(compiled):
    _, program = compiled(bonded=True)
    time, depth = retracting()
    force, _ = program.force(time, depth)
    found, touched = program.displacement(time, force)
    assert np.max(np.abs(found - depth)) <= 1e-12
    assert np.all(touched)


def test_without_a_force_a_loose_pad_is_left_and_recovers(compiled):
    _, program = compiled()
    time = np.linspace(0.0, 60.0, 600)
    force = np.where(time < 5.0, 1.0, np.where(time < 6.0, -1.0, 0.0))
    depth, touched = program.displacement(time, force)
    left = time >= 5.0
    assert np.array_equal(touched, ~left)
    assert np.all(np.diff(depth[~left]) > 0.0)  # creep
    assert np.all(np.diff(depth[left]) < 0.0)  # recovery
    assert np.all(depth[left] > 0.0)
    bears, _ = program.force(time, depth)
    assert np.max(np.abs(bears - np.maximum(force, 0.0))) <= 1e-12


@pytest.mark.parametrize("law", LAWS)
def test_whatever_the_force_does_the_displacement_bears_it(compiled, law):
    """Jumps of the force at steps of no length up to 10 s."""
    _, program = compiled(law)
    rng = np.random.default_rng(5)
    steps = np.where(rng.random(2000) < 0.1, 0.0, 10.0 ** rng.uniform(-5.0, 1.0, 2000))
    time, force = np.cumsum(steps), np.maximum(rng.uniform(-0.3, 2.0, 2000), 0.0)
    found, _ = program.displacement(time, force)
    assert np.all(found >= 0.0)
    bears, _ = program.force(time, found)
    assert np.max(np.abs(bears - force)) <= 1e-12 * np.max(force)


def test_a_force_that_no_displacement_bears_is_told(compiled):
    """Glued, an exponential pad pulls with m/b at most, however fast."""
    pad, program = compiled(bonded=True)
    most = float(pad.elastic.m / pad.elastic.b)
    found, _ = program.displacement(np.array([0.0, 1.0, 2.0]), np.array([0.1, -1.01 * most, 0.1]))
    assert np.isnan(found[1])
    assert np.all(np.isfinite(found[[0, 2]]))


@pytest.mark.parametrize("relaxation", list(RELAXATION))
@pytest.mark.few(1)
def test_every_relaxation_goes_along_as_its_spectrum(compiled, relaxation):
    pad, program = compiled(relaxation=relaxation)
    time, depth = six_tests()[3]
    force, _ = program.force(time, depth)
    expected = python_force(pad, time, depth)
    assert np.max(np.abs(force - expected)) <= EXACT * np.max(np.abs(expected))


def test_step_size_does_not_matter_on_a_ramp(compiled):
    _, program = compiled("polynomial:3")
    fine = np.linspace(0.0, 0.2, 1001)
    coarse = fine[::500]
    force, _ = program.force(fine, 8.0 * fine)
    assert program.force(coarse, 8.0 * coarse)[0] == pytest.approx(force[::500], rel=1e-12)


def test_a_draw_of_the_table_is_a_draw_of_the_posterior(compiled):
    pad, program = compiled()
    assert len(pad.table) == 16
    time = np.array([0.0, 0.1, 10.0])
    depth = np.array([0.0, 1.0, 1.0])
    for i in (0, 15):
        m, b = pad.table.elastic[i]
        c, v = pad.table.fractions[i], pad.table.rates[i]
        ramp = [m * 10 * (exp(b) - exp(-x * 0.1)) / (b * 10 + x) for x in (0.0, *v)]
        hold = [part * exp(-x * 9.9) for part, x in zip(ramp, (0.0, *v), strict=True)]
        force, _ = program.force(time, depth, draw=i)
        assert force[1] == pytest.approx(c @ np.array(ramp), rel=1e-12)
        assert force[2] == pytest.approx(c @ np.array(hold), rel=1e-12)
    assert not np.array_equal(pad.table.elastic[0], pad.table.elastic[15])


@pytest.mark.parametrize("law", ["exponential", "hertz"])
def test_single_precision_drifts_by_no_more_than_the_header_says(compiled, law):
    pad, double = compiled(law)
    _, single = compiled(law, flags=(*STRICT, "-O2", "-DPAD_B_FLOAT"))
    (said,) = re.findall(
        r"up to (\S+) of the peak force", CHeader().files(pad, None)["pad_B.h"].decode()
    )
    time = np.arange(60_000) * 1e-3
    depth = np.interp(time, [0.0, 0.08, 30.0, 30.8, 60.0], [0.0, 1.6, 1.6, 0.8, 0.8])
    expected, _ = double.force(time, depth)
    force, _ = single.force(time, depth)
    assert 0.0 < np.max(np.abs(force - expected)) <= float(said) * np.max(expected)


@pytest.mark.parametrize("law", LAWS)
def test_the_slope_of_a_step_is_its_slope(law):
    force, _, step, slope = (evaluated(function, ELASTIC[law]) for function in functions(law))
    # within the toe of 0.4 and beyond, through its end in both directions, and nearly at rest
    ends = ((0.1, 0.3), (0.5, 0.7), (0.9, 0.6), (0.2, 0.7), (0.8, 0.1), (0.9, 0.90001))
    for (start, stop), decay in product(ends, (0.01, 0.5, 3.0)):

        def at(end, of=step, start=start, decay=decay):
            return of(start, end, force(start), force(end), decay, exp(-decay))

        measured = (at(stop + 1e-5) - at(stop - 1e-5)) / 2e-5
        assert at(stop, slope) == pytest.approx(measured, rel=1e-7)


def test_a_law_that_cannot_be_written_is_refused_with_the_remedy(tmp_path):
    with pytest.raises(InputError, match="spline cannot be written as code; use --to json"):
        CHeader().files(exported(tmp_path, Choices(elastic="spline")), None)
