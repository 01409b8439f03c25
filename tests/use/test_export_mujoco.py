"""MuJoCo: the joint's spring is the polynomial that the file states, the plugin has the memory."""

import subprocess
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from support.compiled_pad import GCC, CompiledPad
from support.exported_pad import exported, missed

from qlvbayes.model.choices import Choices
from qlvbayes.use.exports.reduction import pressing
from qlvbayes.use.exports.simulators import MuJoCo

pytestmark = pytest.mark.integration
WITH = ("viscous_drag", "friction", "stress_softening", "frame_compliance")


@pytest.fixture(scope="module", params=[(), WITH], ids="+".join)
def files(request, tmp_path_factory):
    """Give the exported pad, and the folder with its files."""
    folder = tmp_path_factory.mktemp("mujoco")
    # a process takes one plugin of a name
    pad = exported(folder, Choices(effects=request.param), pad="E" if request.param else "B")
    for name, content in MuJoCo().files(pad, None).items():
        (folder / name).write_bytes(content)
    return pad, folder


def test_the_polynomial_misses_the_force_by_what_the_file_says(files):
    pad, folder = files
    text = (folder / f"{pad.identifier}.xml").read_text()
    joint = ElementTree.fromstring(text).find(".//joint")
    k = [float(x) for x in joint.get("stiffness").split()]
    assert len(k) == 3
    pressed = pressing(pad)
    x = pressed.depth
    force = sum(k[i] * x ** (i + 1) for i in range(3)) + float(joint.get("damping")) * pressed.speed
    rms, largest, hold = missed(pressed, force)
    said = " ".join(text.split())
    assert f"misses the force by {rms:.0%} rms and {largest:.0%} at most" in said
    assert f"{hold:.0%} rms in holds" in said


def test_the_joint_is_the_polynomial(files):
    mujoco = pytest.importorskip("mujoco", reason="no MuJoCo here: the joint is not loaded")
    if mujoco.mj_version() < 3005000:  # before, stiffness was one number
        pytest.skip("MuJoCo before 3.5 has no polynomial springs")
    pad, folder = files
    model = mujoco.MjModel.from_xml_path(str(folder / f"{pad.identifier}.xml"))
    data = mujoco.MjData(model)
    joint = ElementTree.parse(folder / f"{pad.identifier}.xml").getroot().find(".//joint")
    k = [float(x) for x in joint.get("stiffness").split()]
    for depth in (0.2e-3, 1.6e-3):
        data.qpos[0], data.qvel[0] = depth, 0.01
        mujoco.mj_forward(model, data)
        force = sum(k[i] * depth ** (i + 1) for i in range(3)) + 0.01 * float(joint.get("damping"))
        assert data.qfrc_passive[0] == pytest.approx(-force, rel=1e-9)


WORLD = """
<mujoco>
  <option timestep="0.001" gravity="0 0 -9.81"/>
  <extension><plugin plugin="qlvbayes.pad_B"/></extension>
  <worldbody>
    <body>
      <plugin plugin="qlvbayes.pad_B"><config key="joint" value="press"/></plugin>
      <joint name="press" type="slide" axis="0 0 -1"/>
      <geom type="sphere" size="0.01" mass="0.05"/>
    </body>
  </worldbody>
</mujoco>
"""


def test_the_plugin_presses_like_the_header(files):
    """A dead weight of 50 g: its equation of motion, with the header's force, step by step."""
    mujoco = pytest.importorskip("mujoco", reason="no MuJoCo here: the plugin is not run")
    if GCC is None:
        pytest.skip("no gcc here: the plugin is not compiled")
    pad, folder = files
    name = pad.identifier
    home = Path(mujoco.__file__).parent
    (library,) = home.glob("libmujoco.so*")
    flags = ("-O2", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC", f"-I{home / 'include'}")
    command = [GCC, *flags, folder / f"{name}_plugin.c", library, f"-Wl,-rpath,{home}", "-lm"]
    subprocess.run([*command, "-o", folder / f"{name}_plugin.so"], check=True)
    mujoco.mj_loadPluginLibrary(str(folder / f"{name}_plugin.so"))
    model = mujoco.MjModel.from_xml_string(WORLD.replace("pad_B", name))
    data = mujoco.MjData(model)
    depth, press = [], []
    for _ in range(400):
        mujoco.mj_forward(model, data)
        depth.append(1e3 * data.qpos[0])
        press.append(-data.qfrc_passive[0])
        mujoco.mj_step(model, data)
    program = CompiledPad(folder / "c", {p.name: p.read_bytes() for p in folder.glob("*.h")}, name)
    expected, _ = program.force(np.arange(400) * model.opt.timestep, np.array(depth))
    exact = 1e-12 if not pad.effects else 1e-10  # a speed from displacements is rounded
    assert np.max(np.abs(np.array(press) - expected)) <= exact * np.max(expected)
    assert np.max(expected) > 0.05 * 9.81
    # saved and reset with the data
    state = np.zeros(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    mujoco.mj_step(model, data, 50)
    onwards = data.qpos[0]
    mujoco.mj_setState(model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    mujoco.mj_step(model, data, 50)
    assert data.qpos[0] == onwards
    mujoco.mj_resetData(model, data)
    mujoco.mj_forward(model, data)
    assert data.qfrc_passive[0] == 0.0
