"""Exports that step, in C and in Octave: the force of the whole model, and the way back."""

import re
import shutil
import subprocess

import jax.numpy as jnp
import numpy as np
import pytest
from support.compiled_pad import STRICT, CompiledPad, needs_gcc
from support.endtoend import study
from support.exported_pad import EFFECTS, RELAXATION, exported, reference
from support.lawmotions import LAWS, retracting
from support.machine_files import CORPUS

from qlvbayes.effects.catalogue import find
from qlvbayes.io.checks import InputError
from qlvbayes.laws.motion import Motion
from qlvbayes.model.choices import Choices
from qlvbayes.use.exports.code import CHeader, MatlabFunction

OCTAVE = shutil.which("octave-cli") or shutil.which("octave")
EXACT = 1e-12  # of the largest force: rounding a million times in another order
TOGETHER = ("viscous_drag", "fluid_pressure", "stress_softening", "friction", "force_offset")
SETS = [
    *((name,) for name in EFFECTS),
    TOGETHER,
    (*TOGETHER, "strain_dependent_rate", "permanent_set", "frame_compliance", "force_drift"),
    ("channel_lag", "friction", "extra_relaxation_mode", "adhesion"),
]
SOME = ("viscous_drag", "friction", "force_offset")
CASES = [
    *({"elastic": law} for law in LAWS),
    *({"relaxation": relaxation} for relaxation in RELAXATION),
    {"bonded": True},
    *({"effects": SOME, **more} for more in ({"bonded": True}, {"elastic": "hertz"})),
    *({"effects": effects} for effects in SETS),
]  # fmt: skip


def named(case):
    return "+".join(
        "+".join(x) if isinstance(x, tuple) else x if isinstance(x, str) else key
        for key, x in case.items()
    )


def inverts(case):
    return all(find(name).inverts for name in case.get("effects", ()))


INVERTED = [case for case in CASES if inverts(case)]
# of the largest force: k |v|^n has no slope at rest, so that it tells what is rounding of the
# displacement; a frame's four steps leave a little where contact is just lost
LEFT_OPEN = {
    "power_law_drag": 1e-7,
    "guide_power_law_drag": 1e-7,
    "guide_friction": 1e-7,  # where it slides off the pad its force has no slope
    "frame_compliance": 1e-11,
    "stiffening_frame": 1e-11,
}
every_case = pytest.mark.parametrize("case", CASES, ids=named)
TIME = np.arange(401) * 0.01
HELD = np.interp(TIME, [0.0, 0.2, 2.0, 2.5], [0.0, 1.6, 1.6, 1.3])


def motions():
    """Pad B's six bundled tests as they were recorded, and one that leaves the pad."""
    tests = study().pad("B").tests
    assert len(tests) == 6
    recorded = [(np.asarray(test.time), np.asarray(test.displacement)) for test in tests]
    return [*recorded, retracting()]


def whole(model, time, depth):
    """Force of the whole motion in JAX, its speed at a point that of the line which ends there."""
    step = np.diff(time)
    speed = np.where(step > 0.0, np.diff(depth) / np.where(step > 0.0, step, 1.0), 0.0)
    velocity = np.concatenate([[0.0], speed])
    motion = Motion(*map(jnp.asarray, (time, depth, velocity, np.zeros_like(time))))
    return np.asarray(model.force(motion))


def off(found, expected):
    return np.max(np.abs(found - expected)) / np.max(np.abs(expected))


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """Give the exported pad of a case, its compiled header, and the model, once each."""
    known = {}

    def build(case, *flags):
        key = named(case), flags
        if key not in known:
            folder, choices = tmp_path_factory.mktemp("c"), Choices(**case)
            pad = exported(folder, choices, spread=0.0)
            back = all(find(name, choices.kinds).inverts for name in choices.effects)
            one_way = () if back else (*STRICT, "-O1", "-DONE_WAY")
            options = {"flags": (*one_way, *flags)} if one_way or flags else {}
            program = CompiledPad(folder / "c", CHeader().files(pad, None), **options)
            known[key] = pad, program, reference(choices)
        return known[key]

    return build


@needs_gcc
@every_case
@pytest.mark.few(5)
def test_force_is_that_of_the_python_model(compiled, case):
    """On the six tests, and where contact is lost and found."""
    pad, program, model = compiled(case)
    assert pad.left_out == {}
    for time, depth in motions():
        force, touched = program.force(time, depth)
        expected = whole(model, time, depth)
        assert off(force, expected) <= EXACT
    if "effects" not in case:
        assert np.array_equal(touched, (expected > 0.0) | ("bonded" in case))
    assert "bonded" not in case or np.min(expected) < 0.0  # it pulls


@needs_gcc
@pytest.mark.parametrize("case", INVERTED, ids=named)
@pytest.mark.few(5)
def test_a_force_brings_back_its_displacement(compiled, case):
    _, program, _ = compiled(case)
    effects = case.get("effects", ())
    exact = max((LEFT_OPEN.get(name, EXACT) for name in effects), default=EXACT)
    force, touched = program.force(TIME, HELD)
    found, _ = program.displacement(TIME, force)
    assert np.max(np.abs(found - HELD)[touched]) <= EXACT
    assert np.sum(touched) > 0.9 * TIME.size
    runs = motions()
    if len(case) > 1:  # effects in other models
        runs = runs[-1:]
    elif "bonded" not in case:
        runs = runs[:-1]
    for time, depth in runs:
        force, touched = program.force(time, depth)
        found, _ = program.displacement(time, force)
        again, _ = program.force(time, found)
        assert off(again, force) <= exact
        if "effects" not in case or len(case) > 1:
            first = np.argmax(touched)
            left = np.flatnonzero(~touched[first:])  # then the platen may be anywhere outside
            until = first + left[0] if left.size else time.size
            assert until > 0.4 * time.size
            assert np.max(np.abs(found - depth)[first:until]) <= EXACT


@needs_gcc
@pytest.mark.parametrize(
    "case",
    [
        *({"elastic": law} for law in LAWS),
        {"effects": TOGETHER},
        {"effects": ("contact_offset", "frame_compliance")},
    ],
    ids=named,
)
@pytest.mark.few(2)
def test_whatever_the_force_does_the_displacement_bears_it(compiled, case):
    """Jumps of the force at steps of no length up to 10 s; none is below what is read unloaded."""
    _, program, _ = compiled(case)
    rng = np.random.default_rng(5)
    steps = np.where(rng.random(1000) < 0.1, 0.0, 10.0 ** rng.uniform(-3.0, 1.0, 1000))
    least = 0.1 if "effects" in case else -0.3
    time, force = np.cumsum(steps), rng.uniform(least, 2.0, 1000)
    found, _ = program.displacement(time, force)
    bears, _ = program.force(time, found, first=0.0)
    assert np.all(found >= 0.0)
    assert off(bears, np.maximum(force, 0.0)) <= EXACT


@needs_gcc
def test_pads_without_a_force_recover_and_what_bears_none_is_told(compiled):
    _, program, _ = compiled({"elastic": "exponential"})
    time = np.linspace(0.0, 60.0, 600)
    force = np.where(time < 5.0, 1.0, np.where(time < 6.0, -1.0, 0.0))
    depth, touched = program.displacement(time, force)
    left = time >= 5.0
    assert np.array_equal(touched, ~left)
    assert np.all(np.diff(depth[~left]) > 0.0)  # creep
    assert np.all(np.diff(depth[left]) < 0.0)  # recovery
    assert np.all(depth[left] > 0.0)
    # glued, an exponential pad pulls with m/b at most, however fast
    pad, program, _ = compiled({"bonded": True})
    most = float(pad.elastic.m / pad.elastic.b)
    found, _ = program.displacement(np.array([0.0, 1.0, 2.0]), np.array([0.1, -1.01 * most, 0.1]))
    assert np.isnan(found).tolist() == [False, True, False]
    # with an offset of the load cell the reading of an untouched pad is not 0
    _, program, model = compiled({"effects": TOGETHER})
    time, depth = retracting()
    _, touched = program.force(time, depth)
    carried = whole(model, time, depth) - 0.03
    assert np.array_equal(touched, carried > 1e-15)
    assert 0 < np.sum(touched) < touched.size


@needs_gcc
@pytest.mark.parametrize(
    "case", [{"elastic": "hertz"}, {"effects": TOGETHER}, {"effects": ("adhesion",)}], ids=named
)
@pytest.mark.few(2)
def test_single_precision_drifts_by_no_more_than_the_header_says(compiled, case):
    pad, double, _ = compiled(case)
    way = () if inverts(case) else ("-DONE_WAY",)
    _, single, _ = compiled(case, *STRICT, "-O2", "-DPAD_B_FLOAT", *way)
    header = CHeader().files(pad, None)["pad_B.h"].decode()
    (said,) = re.findall(r"up to (\S+) of the peak force", header)
    time = np.arange(60_000) * 1e-3
    depth = np.interp(time, [0.0, 0.08, 30.0, 30.8, 60.0], [0.0, 1.6, 1.6, 0.8, 0.8])
    expected, _ = double.force(time, depth)
    force, _ = single.force(time, depth)
    assert 0.0 < np.max(np.abs(force - expected)) <= float(said) * np.max(expected)


@needs_gcc
def test_a_draw_of_the_table_is_a_draw_of_the_posterior_with_its_own_effects(tmp_path):
    choices = Choices(effects=("viscous_drag", "extra_relaxation_mode"))
    pad = exported(tmp_path, choices)
    program = CompiledPad(tmp_path / "c", CHeader().files(pad, None))
    assert pad.table.effects.shape == (16, 1)
    assert pad.table.fractions.shape == (16, 4)
    assert np.allclose(np.sum(pad.table.fractions, axis=1), 1.0, rtol=0.0, atol=1e-12)
    time, depth = np.array([0.0, 0.1, 0.1, 5.0]), np.array([0.0, 1.0, 1.0, 1.0])
    for i in (0, 15):
        m, b = pad.table.elastic[i]
        c, v = pad.table.fractions[i], np.concatenate([[0.0], pad.table.rates[i]])
        ramp = m * 10.0 * (np.exp(b) - np.exp(-v * 0.1)) / (b * 10.0 + v)
        force, _ = program.force(time, depth, draw=i)
        assert force[2] == pytest.approx(c @ ramp, rel=1e-12)  # a jump of nothing: no speed
        assert force[1] == pytest.approx(c @ ramp + 10.0 * pad.table.effects[i, 0], rel=1e-12)
        assert force[3] == pytest.approx(c @ (ramp * np.exp(-v * 4.9)), rel=1e-12)


OWN = (CORPUS / "own" / "effects.txt").read_text("utf-8")


@needs_gcc
def test_a_users_own_effect_goes_along(compiled, tmp_path):
    (tmp_path / "own.py").write_text(OWN)
    case = {"effects": ("ratchet", "friction"), "effects_file": str(tmp_path / "own.py")}
    pad, program, model = compiled(case)
    assert pad.effects == ("friction", "ratchet")
    for time, depth in motions()[2::4]:
        force, _ = program.force(time, depth)
        assert off(force, whole(model, time, depth)) <= EXACT
    force, _ = program.force(TIME, HELD)
    assert np.max(np.abs(program.displacement(TIME, force)[0] - HELD)) <= EXACT


@pytest.mark.parametrize(
    ("name", "why"), [("inertia", "acceleration"), ("sorting", "sort"), ("looping", "scan")]
)
@pytest.mark.few(2)
def test_what_does_not_step_is_left_out_and_says_why(name, why, tmp_path):
    (tmp_path / "own.py").write_text(OWN)
    choices = Choices(effects=(name, "viscous_drag"), effects_file=str(tmp_path / "own.py"))
    pad = exported(tmp_path, choices, draws=2)
    assert pad.effects == ("viscous_drag",)
    assert why in pad.left_out[name]
    text = " ".join(CHeader().files(pad, None)["pad_B.h"].decode().replace("*", "").split())
    assert f"{name}: {pad.left_out[name]}" in text
    assert "Effect viscous_drag: F += eta v" in text


def test_a_law_that_does_not_step_is_refused(tmp_path):
    with pytest.raises(InputError, match="spline"):
        CHeader().files(exported(tmp_path, Choices(elastic="spline"), draws=2), None)


SCRIPT = """
for i = 1:numel(folders)
  cd(folders{i});
  clear pad_B
  state = pad_B('begin', depth(1));
  back = pad_B('init');
  out = nan(numel(time), 3);
  before = time(1);
  for j = 1:numel(time)
    h = time(j) - before;
    before = time(j);
    [force, state] = pad_B('force', depth(j), h, state);
    out(j, 1:2) = [force, state.contact];
    if inverted(i)
      [out(j, 3), back] = pad_B('displacement', force, h, back);
    end
  end
  if inverted(i) && bonded(i) && isfinite(pad_B('displacement', NaN, 1, back))
    error('a force that is no number has a displacement');
  end
  dlmwrite('out.txt', out, 'precision', '%.17g');
end
"""


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """The folder of every case with what Octave made of it, from one start of Octave."""
    root = tmp_path_factory.mktemp("octave")
    time, depth = (x[::2] for x in retracting())  # Octave takes a millisecond a step
    for i, case in enumerate(CASES):
        pad = exported(root / str(i), Choices(**case), spread=0.0)
        (root / str(i) / "pad_B.m").write_bytes(MatlabFunction().files(pad, None)["pad_B.m"])
    names = ", ".join(f"'{root / str(i)}'" for i in range(len(CASES)))
    back = [int(inverts(case) and len(case.get("effects", ())) < 3) for case in CASES]
    numbers = {"time": time.tolist(), "depth": depth.tolist(), "inverted": back}
    # a loose pad rests at zero where no force is known
    numbers["bonded"] = [int(case.get("bonded", False)) for case in CASES]
    given = [f"{key} = [{' '.join(map(repr, x))}];" for key, x in numbers.items()]
    script = root / "every_case.m"
    script.write_text(f"folders = {{{names}}};\n" + "\n".join(given) + SCRIPT)
    command = [OCTAVE, "--norc", "--no-history", "--quiet", str(script)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=500, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    return root, time, depth, back


@pytest.mark.integration
@pytest.mark.skipif(OCTAVE is None, reason="no GNU Octave here: the function is not run")
@every_case
@pytest.mark.few(6)
def test_octave_has_the_force_and_the_displacement_too(ran, case):
    root, time, depth, back = ran
    place = CASES.index(case)
    force, contact, found = np.loadtxt(root / str(place) / "out.txt", delimiter=",").T
    assert off(force, whole(reference(Choices(**case)), time, depth)) <= EXACT
    left = np.flatnonzero((contact < 0.5) & (time > 1.0))
    until = left[0] if left.size else time.size
    touched = (contact > 0.5)[:until]
    assert np.sum(touched) > 25
    if back[place]:
        assert np.max(np.abs(found - depth)[:until][touched]) <= EXACT
