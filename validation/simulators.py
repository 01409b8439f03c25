"""Contacts in the simulators themselves: exported files loaded, depth and speed set, force read."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import numpy as np

_PLATEN = 0.02  # m, its thickness
_WIDER = 4.0  # sides of the platen in one of the pad: the patch then ends at the platen's edges


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
