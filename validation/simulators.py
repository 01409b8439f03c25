"""Exports and contacts in other programs: files loaded, depth and speed set, force read.

`TARGETS` runs an export of the whole model along a motion; `of_mujoco` and `of_drake` run contacts.
"""

from __future__ import annotations

import importlib.util
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

_PLATEN = 0.02  # m, its thickness
_WIDER = 4.0  # sides of the platen in one of the pad: the patch then ends at the platen's edges

_DRIVER = """#include <stdio.h>
#include "NAME.h"
int main(void) {
    const NAME_constants k = UPPER_MEDIAN;
    NAME_state s;
    double h, d;
    int first = 1;
    while (scanf("%lf %lf", &h, &d) == 2) {
        if (first) { NAME_begin(&k, &s, d); }
        first = 0;
        printf("%.17g\\n", NAME_force(&k, &s, h, d));
    }
    return 0;
}
"""
_WORLD = """<mujoco><option gravity="0 0 0"/>
<extension><plugin plugin="qlvbayes.NAME"/></extension>
<worldbody><body><plugin plugin="qlvbayes.NAME"><config key="joint" value="press"/></plugin>
<joint name="press" type="slide" axis="0 0 -1"/><geom type="sphere" size="0.01" mass="1e12"/>
</body></worldbody></mujoco>"""
_OCTAVE = """state = NAME('begin', rows(1, 2));
force = zeros(rows(end, 3), 1);
for i = 1:size(rows, 1)
  [force(i), state] = NAME('force', rows(i, 2), rows(i, 1), state);
end
printf('%.17g\\n', force);
"""

Run = Callable[[Path, str, np.ndarray, np.ndarray], np.ndarray]
"""Force (N,) of an export (its folder and name) along steps (s) to displacements, both (N,)."""


def of_header(folder: Path, name: str, step: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """By the C header, compiled."""
    source = folder / "run.c"
    source.write_text(_DRIVER.replace("NAME", name).replace("UPPER", name.upper()))
    command = ["gcc", "-std=c99", "-O2", str(source), "-o", str(folder / "run"), "-lm"]
    subprocess.run(command, check=True)
    return _read([str(folder / "run")], _rows(step, depth))


def of_unit(folder: Path, name: str, step: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """By the FMU, its input's derivative set, so that the force is on time."""
    import fmpy
    from fmpy.fmi2 import FMU2Slave

    path = str(folder / f"{name}.fmu")
    read = fmpy.read_model_description(path)
    unit = FMU2Slave(
        guid=read.guid,
        unzipDirectory=fmpy.extract(path),
        modelIdentifier=read.coSimulation.modelIdentifier,
    )
    unit.instantiate()
    unit.setupExperiment(startTime=0.0)
    unit.enterInitializationMode()
    unit.setReal([0], [depth[0]])
    unit.exitInitializationMode()
    force, time = unit.getReal([3]), 0.0
    for h, start, stop in zip(step[1:], depth[:-1], depth[1:], strict=True):
        unit.setReal([0], [start])
        unit.setRealInputDerivatives([0], [1], [(stop - start) / h])
        unit.doStep(time, h)
        force += unit.getReal([3])
        time += h
    unit.freeInstance()
    return np.array(force)


def of_plugin(folder: Path, name: str, step: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """By MuJoCo with the plugin, on a mass so large that the joint goes as it is sent."""
    import mujoco

    model, position = _plugin_model(folder, name), 1e-3 * depth
    data, force = mujoco.MjData(model), []
    travel = np.diff(position, prepend=position[0])
    for h, way, end in zip(step.tolist(), travel.tolist(), position.tolist(), strict=True):
        speed = way / h if h > 0.0 else 0.0
        if h > 0.0:
            model.opt.timestep, data.qpos[0], data.qvel[0] = h, end - way, speed
            mujoco.mj_step(model, data)
        data.qpos[0], data.qvel[0] = end, speed
        mujoco.mj_forward(model, data)
        force.append(-float(data.qfrc_passive[0]))
    return np.array(force)


@cache
def _plugin_model(folder: Path, name: str) -> Any:
    """MuJoCo's model of an export; a process takes one plugin of a name, so each gets its own."""
    import mujoco

    own = f"{name}_{folder.parents[2].name}"
    source = folder / f"{own}.c"
    plugin = (folder / f"{name}_plugin.c").read_text()
    source.write_text(plugin.replace(f"qlvbayes.{name}", f"qlvbayes.{own}"))
    home, made = Path(mujoco.__file__).parent, folder / f"{own}.so"
    (library,) = home.glob("libmujoco.so*")
    command = ["gcc", "-O2", "-shared", "-fPIC", f"-I{home / 'include'}", str(source)]
    command += [str(library), f"-Wl,-rpath,{home}", "-lm", "-o", str(made)]
    subprocess.run(command, check=True)
    mujoco.mj_loadPluginLibrary(str(made))
    return mujoco.MjModel.from_xml_string(_WORLD.replace("NAME", own))


def of_octave(folder: Path, name: str, step: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """By the MATLAB function in GNU Octave."""
    numbers = "\n".join(
        f"{h!r} {d!r} {len(step)}" for h, d in zip(step.tolist(), depth.tolist(), strict=True)
    )
    script = folder / "run.m"
    script.write_text(f"cd('{folder}');\nrows = [{numbers}];\n" + _OCTAVE.replace("NAME", name))
    return _read(["octave-cli", "--norc", "--quiet", str(script)], "")


TARGETS: dict[str, tuple[Run, str]] = {
    "c": (of_header, "gcc"),
    "fmu": (of_unit, "fmpy"),
    "mujoco": (of_plugin, "mujoco"),
    "matlab": (of_octave, "octave-cli"),
}
"""Functions that run each export, with the program or package needed in addition to gcc."""


def _rows(step: np.ndarray, depth: np.ndarray) -> str:
    return "".join(f"{h!r} {d!r}\n" for h, d in zip(step.tolist(), depth.tolist(), strict=True))


def _read(program: list[str], rows: str) -> np.ndarray:
    done = subprocess.run(program, input=rows, capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(f"{program[0]}: {done.stderr.strip()}")
    return np.array(done.stdout.split(), dtype=float)


def lacking(needed: str) -> bool:
    """Return whether this machine has neither a program nor a package of that name."""
    return shutil.which(needed) is None and importlib.util.find_spec(needed) is None


def of_mujoco(
    text: str, depth: np.ndarray, speed: np.ndarray, acceleration: np.ndarray | float = 0.0
) -> np.ndarray:
    """Force (n,) in N of the exported contact; of depth (m), speed (m/s), acceleration (m/s2).

    MuJoCo's own inverse dynamics gives what the contact bears in a given motion.
    """
    import mujoco

    model = mujoco.MjModel.from_xml_string(text)
    data, force = mujoco.MjData(model), []
    rows = np.broadcast_arrays(depth, speed, acceleration)
    for x, v, a in zip(*(row.tolist() for row in rows), strict=True):
        mujoco.mj_resetData(model, data)
        data.qpos[2] -= x
        data.qvel[2], data.qacc[2] = -v, -a
        mujoco.mj_inverse(model, data)
        force.append(float(data.efc_force[0]) if data.nefc else 0.0)
    return np.array(force)


def of_drake(
    text: str,
    depth: np.ndarray,
    speed: np.ndarray,
    *,
    height: float = 0.01,
    area: float = 2e-4,
    hydroelastic: bool = False,
) -> np.ndarray:
    """Force (n,) in N of a hard face of that area (m2) on a wider box of that height (m).

    text: the exported properties, of the box.
    """
    import pydrake.all as drake

    builder = drake.DiagramBuilder()
    plant, _ = drake.AddMultibodyPlantSceneGraph(builder, 0.0)
    plant.set_adjacent_bodies_collision_filters(False)
    models = drake.ContactModel
    plant.set_contact_model(models.kHydroelastic if hydroelastic else models.kPoint)
    drake.Parser(plant).AddModelsFromString(_world(text, height, area), "sdf")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("pad"))
    plant.Finalize()
    diagram = builder.Build()
    whole = diagram.CreateDefaultContext()
    context = plant.GetMyMutableContextFromRoot(whole)
    slide, force = plant.GetJointByName("slide"), []
    for x, v in zip(depth.tolist(), speed.tolist(), strict=True):
        slide.set_translation(context, -x)
        slide.set_translation_rate(context, -v)
        found = plant.get_contact_results_output_port().Eval(context)
        force.append(sum(map(abs, _normal(found, hydroelastic))))
    return np.array(force)


def _normal(found: Any, hydroelastic: bool) -> Iterator[float]:
    """Vertical forces of all contacts."""
    if hydroelastic:
        for i in range(found.num_hydroelastic_contacts()):
            yield found.hydroelastic_contact_info(i).F_Ac_W().translational()[2]
        return
    for i in range(found.num_point_pair_contacts()):
        yield found.point_pair_contact_info(i).contact_force()[2]


def _world(text: str, height: float, area: float) -> str:
    """A pad of the exported properties, and a hard platen without friction on a slide above it."""
    (own,) = re.findall(r"<drake:proximity_properties.*?>(.*)</drake:proxi", text, re.DOTALL)
    side = area**0.5
    hard = (
        "<drake:point_contact_stiffness>1e30</drake:point_contact_stiffness>"
        "<drake:rigid_hydroelastic/><drake:mu_static>0</drake:mu_static>"
        "<drake:mu_dynamic>0</drake:mu_dynamic>"
    )

    def solid(width: float, thick: float, middle: float, properties: str) -> str:
        return (
            f'<collision name="c"><pose>0 0 {middle} 0 0 0</pose>'
            f"<geometry><box><size>{width} {width} {thick}</size></box></geometry>"
            f"<drake:proximity_properties>{properties}</drake:proximity_properties></collision>"
        )

    return f"""<sdf version="1.7"><model name="m">
    <link name="pad">{solid(_WIDER * side, height, -0.5 * height, own)}</link>
    <link name="platen">{solid(side, _PLATEN, 0.5 * _PLATEN, hard)}</link>
    <joint name="slide" type="prismatic"><parent>pad</parent><child>platen</child>
    <axis><xyz>0 0 1</xyz></axis></joint></model></sdf>"""
