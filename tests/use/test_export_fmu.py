"""The FMU: valid, and its co-simulation is the header's force; its state can be got and set."""

import io
import subprocess
import zipfile

import numpy as np
import pytest
from support.compiled_pad import CHECKED, GCC, STRICT, CompiledPad, needs_gcc
from support.exported_pad import described, exported

from qlvbayes.model.choices import Choices
from qlvbayes.use.exports.code import CHeader, Fmu

fmpy = pytest.importorskip("fmpy", reason="no FMPy here: the FMU is not simulated")

pytestmark = pytest.mark.integration
H = 1.0 / 1024.0  # a power of two: times add up without rounding
TIME = np.arange(2049) * H
DEPTH = np.interp(TIME, [0.0, 0.125, 1.0, 1.5, 2.0], [0.0, 1.6, 1.6, 0.9, 1.2])


EXACT = 1e-12
WITH = ("viscous_drag", "friction", "stress_softening", "force_offset")


def built(folder, choices, *flags, **options):
    """Path of an FMU, and the same pad's compiled header."""
    if GCC is None:
        pytest.skip("no gcc here: the FMU has no binary")
    pad, path = exported(folder, choices, **options), folder / "pad_B.fmu"
    path.write_bytes(Fmu().files(pad, None)["pad_B.fmu"])
    return path, CompiledPad(folder / "c", CHeader().files(pad, None), flags=flags or CHECKED)


@pytest.fixture(scope="module", params=["loose", "bonded", "effects"])
def unit(request, tmp_path_factory):
    effects = WITH if request.param == "effects" else ()
    choices = Choices(bonded=request.param == "bonded", effects=effects)
    return built(tmp_path_factory.mktemp("fmu"), choices)


def simulated(path, name, values, **options):
    signals = np.array(list(zip(TIME, values, strict=True)), dtype=[("time", float), (name, float)])
    found = fmpy.simulate_fmu(
        path, stop_time=TIME[-1], output_interval=H, input=signals,
        output=["displacement", "force", "contact"], **options,
    )  # fmt: skip
    assert np.array_equal(found["time"], TIME)
    return found


def test_it_is_a_valid_fmu(unit):
    from fmpy.model_description import read_model_description
    from fmpy.validation import validate_fmu

    assert list(validate_fmu(str(unit[0]))) == []
    read = read_model_description(str(unit[0]), validate=True)
    assert read.coSimulation.canGetAndSetFMUstate
    assert read.coSimulation.canSerializeFMUstate
    units = {v.name: v.unit for v in read.modelVariables}
    assert (units["displacement"], units["force"]) == ("mm", "N")


def late(values):
    """Return what an importer sets that knows the input at the beginning of each step."""
    return np.concatenate([values[:1], values[:-1]])


def assert_force_of(path, program, draw=-1, **options):
    """The unit's force is the header's along the displacement; return what was simulated."""
    found = simulated(path, "displacement_in", DEPTH, **options)
    expected, touched = program.force(TIME, late(DEPTH), draw=draw)
    assert np.max(np.abs(found["force"] - expected)) <= EXACT * np.max(expected)
    assert np.max(np.abs(found["displacement"] - late(DEPTH))) <= EXACT
    assert np.array_equal(found["contact"], touched)
    return expected


def test_forces_and_displacements_are_the_headers_for_every_draw(unit):
    path, program = unit
    median = assert_force_of(path, program)
    drawn = assert_force_of(path, program, draw=2, start_values={"draw": 3})
    assert np.max(np.abs(drawn - median)) > 1e-3
    force = np.interp(TIME, [0.0, 0.1, 2.0], [0.0, 1.0, 1.0])
    found = simulated(path, "force_in", force, start_values={"prescribe_force": True})
    expected, _ = program.displacement(TIME, late(force))
    assert np.max(np.abs(found["displacement"] - expected)) <= EXACT
    bears, _ = program.force(TIME, expected, first=0.0)
    assert np.max(np.abs(found["force"] - bears)) <= EXACT
    asked = late(force) > 0.04  # what is read unloaded is the least
    assert np.max(np.abs(bears - late(force))[asked]) <= EXACT


@pytest.fixture
def slave(unit, tmp_path):
    """Give the FMU's interface itself, initialised."""
    from fmpy.fmi2 import FMU2Slave
    from fmpy.model_description import read_model_description

    read = read_model_description(str(unit[0]))
    found = FMU2Slave(
        guid=read.guid,
        unzipDirectory=fmpy.extract(str(unit[0]), str(tmp_path)),
        modelIdentifier=read.coSimulation.modelIdentifier,
    )
    found.instantiate()
    found.setupExperiment(startTime=0.0)
    found.enterInitializationMode()
    found.exitInitializationMode()
    yield found
    found.freeInstance()


def test_with_derivatives_the_force_is_on_time(unit, slave):
    forces = slave.getReal([3])
    for i in range(TIME.size - 1):
        slave.setReal([0], [DEPTH[i]])
        slave.setRealInputDerivatives([0], [1], [(DEPTH[i + 1] - DEPTH[i]) / H])
        slave.doStep(TIME[i], H)
        forces += slave.getReal([3])
    expected, _ = unit[1].force(TIME, DEPTH)
    assert np.max(np.abs(np.array(forces) - expected)) <= EXACT * np.max(expected)


KNOTS = np.array([0.0, 0.125, 1.0])  # multiples of a step: a step ends at the kink
LOADED = np.array([[0.0, 1.6, 1.6]])


def test_at_a_kink_an_importers_slope_of_the_line_before_overshoots_for_one_step(unit, slave):
    """FMPy interpolates so; the next value that is set puts the displacement right, by a jump."""
    depth, force, path = [0.0], slave.getReal([3]), [(0.0, 0.0)]
    for i in range(256):
        value, slope = fmpy.simulation.Input.interpolate(i * H, KNOTS, LOADED)
        slave.setReal([0], [float(value[0])])
        slave.setRealInputDerivatives([0], [1], [float(slope[0])])
        slave.doStep(i * H, H)
        path += [(i * H, float(value[0])), ((i + 1) * H, float(value[0] + H * slope[0]))]
        depth += slave.getReal([2])
        force += slave.getReal([3])
    over = np.array(depth) - np.interp(np.arange(257) * H, KNOTS, LOADED[0])
    kink = int(KNOTS[1] / H) + 1
    assert over[kink] == pytest.approx(1.6 / KNOTS[1] * H, rel=1e-9)
    assert np.max(np.abs(np.delete(over, [1, kink]))) <= EXACT  # it has no slope at the first knot
    time, places = np.array(path).T
    expected, _ = unit[1].force(time, places)
    assert np.max(np.abs(np.array(force) - expected[::2])) <= EXACT * np.max(expected)


def test_it_never_goes_beyond_the_values_that_it_is_given(slave):
    """Without slopes: not in a jump, not at a kink, nor in steps of any length."""
    rng = np.random.default_rng(3)
    values, steps = rng.uniform(0.0, 1.6, 200), rng.uniform(1e-6, 2.0, 200)
    time = 0.0
    for value, h in zip(values.tolist(), steps.tolist(), strict=True):
        slave.setReal([0], [value])
        slave.doStep(time, h)
        assert slave.getReal([2]) == [value]
        time += h


def test_the_state_is_saved_serialised_and_restored(slave, request):
    read_at_rest = 0.03 if "effects" in request.node.name else 0.0

    def ramp(first, steps):
        forces = []
        for i in range(first, first + steps):
            slave.setReal([0], [0.01 * (i + 1)])
            slave.doStep(i * H, H)
            forces += slave.getReal([3])
        return forces

    ramp(0, 50)
    state = slave.getFMUState()
    bytes_of = slave.serializeFMUState(state)
    onwards = ramp(50, 20)
    slave.setFMUState(state)
    assert ramp(50, 20) == onwards
    ramp(70, 10)
    again = slave.deserializeFMUState(bytes_of)
    slave.setFMUState(again)
    assert ramp(50, 20) == onwards
    slave.reset()
    at_rest = slave.getReal([3])[0]
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    assert at_rest == slave.getReal([3])[0] == pytest.approx(read_at_rest, abs=0.002)


def test_what_has_no_way_back_refuses_a_force(tmp_path):
    path, program = built(tmp_path, Choices(effects=("channel_lag",)), *STRICT, "-DONE_WAY")
    with pytest.raises(Exception, match="fmi2ExitInitializationMode failed"):
        simulated(path, "force_in", 1.0 + DEPTH, start_values={"prescribe_force": True})
    assert_force_of(path, program)


@needs_gcc
@pytest.mark.parametrize("effects", [(), WITH, ("channel_lag",)], ids="+".join)
def test_sources_are_inside_and_strict(tmp_path, effects):
    pad = exported(tmp_path, Choices(effects=effects))
    content = Fmu().files(pad, None)["pad_B.fmu"]
    assert content == Fmu().files(pad, None)["pad_B.fmu"]
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        archive.extractall(tmp_path / "unit")
    sources = tmp_path / "unit" / "sources"
    assert {path.name for path in sources.iterdir()} == {"fmu.c", "pad_B.h", "pad_B_draws.h"}
    flags = (*STRICT, "-fPIC", "-shared", "-fsanitize=undefined")
    command = [GCC, *flags, "-o", tmp_path / "unit.so", sources / "fmu.c", "-lm"]
    subprocess.run(command, check=True)


def test_a_described_law_is_in_it(tmp_path):
    """A law that a diagnosis described, with a state and in the force, as in the header."""
    names = "factor_of_remembered_elastic_force", "power_drag_of_depth_squared"
    assert_force_of(*built(tmp_path, described(tmp_path, *names), *STRICT, "-DONE_WAY", spread=0.0))
