"""Effects in other languages: the force of the whole model, and the way back."""

import re
import subprocess

import jax.numpy as jnp
import numpy as np
import pytest
from support.compiled_pad import STRICT, CompiledPad, needs_gcc
from support.endtoend import study
from support.exported_pad import EFFECTS, exported, reference
from support.lawmotions import retracting
from support.octave import OCTAVE

from qlvbayes.effects.catalogue import find
from qlvbayes.laws.motion import Motion
from qlvbayes.model.choices import Choices
from qlvbayes.use.exports.c_header import CHeader
from qlvbayes.use.exports.matlab import MatlabFunction

EXACT = 1e-12  # of the largest force
TOGETHER = ("viscous_drag", "fluid_pressure", "stress_softening", "friction", "force_offset")
CASES = [
    *((name,) for name in EFFECTS),
    TOGETHER,
    (*TOGETHER, "strain_dependent_rate", "permanent_set", "frame_compliance", "force_drift"),
    ("channel_lag", "friction", "extra_relaxation_mode", "adhesion"),
]


def six_tests():
    """Time and displacement of pad B's six bundled tests, as they were recorded."""
    return [
        (np.asarray(test.time), np.asarray(test.displacement)) for test in study().pad("B").tests
    ]


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
    """Give a pad with these effects, its compiled header, and the model."""
    known = {}

    def build(*effects, **options):
        key = effects, *options.items()
        if key not in known:
            folder = tmp_path_factory.mktemp("c")
            choices = Choices(effects=effects, **options)
            pad = exported(folder, choices, spread=0.0)
            back = all(find(name, choices.kinds).inverts for name in effects)
            flags = {} if back else {"flags": (*STRICT, "-O1", "-DONE_WAY")}
            program = CompiledPad(folder / "c", CHeader().files(pad, None), **flags)
            known[key] = pad, program, reference(choices)
        return known[key]

    return build


@needs_gcc
@pytest.mark.parametrize("effects", CASES, ids="+".join)
@pytest.mark.few(7)
def test_force_is_that_of_the_python_model_on_the_six_tests(compiled, effects):
    pad, program, model = compiled(*effects)
    assert pad.left_out == {}
    tests = six_tests()
    assert len(tests) == 6
    for time, depth in [*tests, retracting()]:
        force, _ = program.force(time, depth)
        assert off(force, whole(model, time, depth)) <= EXACT


INVERTED = [names for names in CASES if all(find(name).inverts for name in names)]
TIME = np.arange(401) * 0.01
HELD = np.interp(TIME, [0.0, 0.2, 2.0, 2.5], [0.0, 1.6, 1.6, 1.3])
# of the largest force: k |v|^n has no slope at rest, so that it tells what is rounding of the
# displacement; a frame's four steps leave a little where contact is just lost
LEFT_OPEN = {
    "power_law_drag": 1e-7,
    "guide_power_law_drag": 1e-7,
    "guide_friction": 1e-7,  # where it slides off the pad its force has no slope
    "frame_compliance": 1e-11,
    "stiffening_frame": 1e-11,
}


@needs_gcc
@pytest.mark.parametrize("effects", INVERTED, ids="+".join)
@pytest.mark.few(7)
def test_a_force_brings_back_its_displacement(compiled, effects):
    _, program, _ = compiled(*effects)
    exact = max(LEFT_OPEN.get(name, EXACT) for name in effects)
    force, touched = program.force(TIME, HELD)
    found, _ = program.displacement(TIME, force)
    assert np.max(np.abs(found - HELD)[touched]) <= EXACT
    assert np.sum(touched) > 0.9 * TIME.size
    for time, depth in six_tests():
        force, _ = program.force(time, depth)
        found, _ = program.displacement(time, force)
        again, _ = program.force(time, found)
        assert off(again, force) <= exact


@needs_gcc
@pytest.mark.parametrize(
    "effects", [TOGETHER, ("contact_offset", "frame_compliance")], ids="+".join
)
def test_whatever_the_force_does_the_displacement_bears_it(compiled, effects):
    """Jumps of the force at steps of no length up to 10 s; none is below what is read unloaded."""
    _, program, _ = compiled(*effects)
    rng = np.random.default_rng(5)
    steps = np.where(rng.random(1000) < 0.1, 0.0, 10.0 ** rng.uniform(-3.0, 1.0, 1000))
    time, force = np.cumsum(steps), rng.uniform(0.1, 2.0, 1000)
    found, _ = program.displacement(time, force)
    bears, _ = program.force(time, found, first=0.0)
    assert off(bears, force) <= EXACT


@needs_gcc
@pytest.mark.parametrize("effects", [TOGETHER, ("adhesion",)], ids="+".join)
def test_single_precision_drifts_by_no_more_than_the_header_says(compiled, effects, tmp_path):
    pad, double, _ = compiled(*effects)
    way = () if all(find(name).inverts for name in effects) else ("-DONE_WAY",)
    files = CHeader().files(pad, None)
    single = CompiledPad(tmp_path, files, flags=(*STRICT, "-O2", "-DPAD_B_FLOAT", *way))
    (said,) = re.findall(r"up to (\S+) of the peak force", files["pad_B.h"].decode())
    time = np.arange(60_000) * 1e-3
    depth = np.interp(time, [0.0, 0.08, 30.0, 30.8, 60.0], [0.0, 1.6, 1.6, 0.8, 0.8])
    expected, _ = double.force(time, depth)
    force, _ = single.force(time, depth)
    assert 0.0 < np.max(np.abs(force - expected)) <= float(said) * np.max(expected)


@needs_gcc
def test_touch_is_that_of_the_specimen(compiled):
    """With an offset of the load cell the reading of an untouched pad is not 0."""
    _, program, model = compiled(*TOGETHER)
    time, depth = retracting()
    _, touched = program.force(time, depth)
    carried = whole(model, time, depth) - 0.03
    assert np.array_equal(touched, carried > 1e-15)
    assert 0 < np.sum(touched) < touched.size


OWN = """
import jax
import jax.numpy as jnp
from typing import Any, ClassVar
from qlvbayes.effects import AbstractEffect, Level


class Ratchet(AbstractEffect):
    \"\"\"Force that grows with the way so far: one number in memory, a table, a sum over it.\"\"\"

    size: Any
    name: ClassVar[str] = "ratchet"
    level: ClassVar[Level] = Level.ADDING
    rank: ClassVar[int] = 9
    units: ClassVar[dict[str, str]] = {"size": "stiffness"}
    null: ClassVar[dict[str, float]] = {"size": 0.0}
    law: ClassVar[str] = "F += size (1 + tanh way + way^2/9)"
    seen: ClassVar[str] = "stiffer after every move"
    reference: ClassVar[str] = "none"

    @classmethod
    def default(cls, scales):
        return cls(scales.positive(scales.depth))

    def force(self, below, motion):
        place = motion.alone.displacement
        way = jnp.cumsum(jnp.abs(jnp.diff(place, prepend=place[:1])))
        return below.force(motion) + self.size * self._grown(way)

    def _grown(self, way):
        powers = jnp.stack([jnp.ones_like(way), jnp.tanh(way), way**2])
        return jnp.array([1.0, 1.0, 1.0 / 9.0]) @ powers

    def begin(self, below, displacement):
        return below.begin(displacement), {"at": displacement, "way": 0.0 * displacement}

    def step(self, below, state, line):
        inner, own = state
        inner, force = below.step(inner, line)
        way = own["way"] + jnp.abs(line.displacement - own["at"])
        return (inner, {"at": line.displacement, "way": way}), force + self.size * self._grown(way)


class Sorting(Ratchet):
    \"\"\"Its step sorts, which no other language has in one word.\"\"\"

    name: ClassVar[str] = "sorting"
    rank: ClassVar[int] = 10

    def step(self, below, state, line):
        state, force = super().step(below, state, line)
        return state, force + 0.0 * jnp.sort(jnp.stack([force, self.size]))[0]


class Looping(Ratchet):
    \"\"\"Its step loops.\"\"\"

    name: ClassVar[str] = "looping"
    rank: ClassVar[int] = 11

    def step(self, below, state, line):
        state, force = super().step(below, state, line)
        return state, jax.lax.fori_loop(0, 3, lambda _, x: x + self.size, force)
"""


@needs_gcc
def test_a_users_own_effect_goes_along(compiled, tmp_path):
    (tmp_path / "own.py").write_text(OWN)
    own = str(tmp_path / "own.py")
    pad, program, model = compiled("ratchet", "friction", effects_file=own)
    assert pad.effects == ("friction", "ratchet")
    for time, depth in [retracting(), six_tests()[2]]:
        force, _ = program.force(time, depth)
        assert off(force, whole(model, time, depth)) <= EXACT
    force, _ = program.force(TIME, HELD)
    assert np.max(np.abs(program.displacement(TIME, force)[0] - HELD)) <= EXACT


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("inertia", "straight lines have no acceleration but at their ends"),
        ("sorting", "its step uses sort, which has no form in other languages"),
        ("looping", "its step uses scan, which has no form in other languages"),
    ],
)
def test_what_does_not_step_is_left_out_and_says_why(name, why, tmp_path):
    (tmp_path / "own.py").write_text(OWN)
    choices = Choices(effects=(name, "viscous_drag"), effects_file=str(tmp_path / "own.py"))
    pad = exported(tmp_path, choices)
    assert pad.effects == ("viscous_drag",)
    assert why in pad.left_out[name]
    text = " ".join(CHeader().files(pad, None)["pad_B.h"].decode().replace("*", "").split())
    assert f"- the added effect {name}: {pad.left_out[name]}" in text
    assert "Effect viscous_drag: F += eta v" in text


def test_a_way_back_that_is_not_there_says_why(tmp_path):
    pad = exported(tmp_path, Choices(effects=("adhesion",)))
    text = CHeader().files(pad, None)["pad_B.h"].decode()
    assert "pad_B_displacement" not in text
    assert f"- displacement from force: adhesion: {find('adhesion').not_inverted}" in text


@needs_gcc
def test_draws_carry_their_own_effects(tmp_path):
    choices = Choices(effects=("viscous_drag", "extra_relaxation_mode"))
    pad = exported(tmp_path, choices)
    program = CompiledPad(tmp_path / "c", CHeader().files(pad, None))
    assert pad.table.effects.shape == (16, 1)
    assert pad.table.fractions.shape == (16, 4)
    assert np.allclose(np.sum(pad.table.fractions, axis=1), 1.0, rtol=0.0, atol=1e-12)
    time = np.array([0.0, 0.1, 0.1, 5.0])
    depth = np.array([0.0, 1.0, 1.0, 1.0])
    for i in (0, 15):
        m, b = pad.table.elastic[i]
        c, v = pad.table.fractions[i], np.concatenate([[0.0], pad.table.rates[i]])
        ramp = m * 10.0 * (np.exp(b) - np.exp(-v * 0.1)) / (b * 10.0 + v)
        force, _ = program.force(time, depth, draw=i)
        assert force[2] == pytest.approx(c @ ramp, rel=1e-12)  # a jump of nothing: no speed
        assert force[1] == pytest.approx(c @ ramp + 10.0 * pad.table.effects[i, 0], rel=1e-12)
        assert force[3] == pytest.approx(c @ (ramp * np.exp(-v * 4.9)), rel=1e-12)


OCTAVE_SCRIPT = """
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
  dlmwrite('out.txt', out, 'precision', '%.17g');
end
"""


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """Every case's model and what Octave made of it, from one start of Octave."""
    root = tmp_path_factory.mktemp("octave")
    time, depth = (x[::2] for x in retracting())
    pads = []
    for i, effects in enumerate(CASES):
        pad = exported(root / str(i), Choices(effects=effects), spread=0.0)
        (root / str(i) / "pad_B.m").write_bytes(MatlabFunction().files(pad, None)["pad_B.m"])
        pads.append(reference(Choices(effects=effects)))
    names = ", ".join(f"'{root / str(i)}'" for i in range(len(CASES)))
    back = [int(effects in INVERTED and len(effects) < 3) for effects in CASES]
    numbers = {"time": time.tolist(), "depth": depth.tolist(), "inverted": back}
    given = [f"{key} = [{' '.join(map(repr, x))}];" for key, x in numbers.items()]
    script = root / "every_case.m"
    script.write_text(f"folders = {{{names}}};\n" + "\n".join(given) + OCTAVE_SCRIPT)
    command = [OCTAVE, "--norc", "--no-history", "--quiet", str(script)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=500, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    return root, pads, time, depth, back


@pytest.mark.skipif(OCTAVE is None, reason="no GNU Octave here: the function is not run")
@pytest.mark.parametrize("case", range(len(CASES)), ids=["+".join(x) for x in CASES])
@pytest.mark.few(5)
def test_octave_has_the_force_and_the_displacement_too(ran, case):
    root, models, time, depth, back = ran
    force, contact, found = np.loadtxt(root / str(case) / "out.txt", delimiter=",").T
    assert off(force, whole(models[case], time, depth)) <= EXACT
    left = np.flatnonzero((contact < 0.5) & (time > 1.0))[0]
    touched = (contact > 0.5)[:left]
    assert np.sum(touched) > 25
    if back[case]:
        assert np.max(np.abs(found - depth)[:left][touched]) <= EXACT


@needs_gcc
@pytest.mark.parametrize("options", [{"bonded": True}, {"law": "hertz"}, {"relaxation": "fung"}])
def test_other_models_take_effects_too(compiled, options):
    """Glued ones pull, and come back from it; a law may have no stiffness where it begins."""
    _, program, model = compiled("viscous_drag", "friction", "force_offset", **options)
    time, depth = retracting()
    force, touched = program.force(time, depth)
    assert off(force, whole(model, time, depth)) <= EXACT
    assert (np.min(force) < 0.0) == options.get("bonded", False)
    found, _ = program.displacement(time, force)
    until = time.size if options.get("bonded") else np.flatnonzero(~touched & (time > 1.0))[0]
    assert np.max(np.abs(found - depth)[:until][touched[:until]]) <= EXACT
