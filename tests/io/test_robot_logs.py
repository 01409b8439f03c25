"""Logs of robots: which of many channels is force and which displacement, by which clock."""

import numpy as np
import pytest
from support.machine_files import CORPUS, STORED

from qlvbayes.io import binary
from qlvbayes.io.binary import meaning, of_topics
from qlvbayes.io.checks import InputError
from qlvbayes.io.conversion import convert
from qlvbayes.io.loading import Answers
from qlvbayes.io.recording import UnsureError

MCAP = b"\x89MCAP0\r\n"


def bag(folder, suffix):
    pytest.importorskip("rosbags", reason="rosbags is not installed: no bag is read")
    path = folder / "log.mcap"
    path.write_bytes((CORPUS / "other" / f"joints.{suffix}").read_bytes())
    return path


@pytest.mark.parametrize(
    ("name", "quantity", "unit"),
    [
        ("wrench.force.z", "force", "N"),
        (".pose.position.x", "displacement", "m"),
        ("/tf.transform.translation.y", "displacement", "m"),
        ("/joint_states.position[slide]", "displacement", ""),
        ("/rig/displacement_um.data", "displacement", "um"),
        ("/cell/force.data", "force", ""),
        *((name, None, None) for name in ("wrench.torque.z", "header.stamp.sec", "/t.data",
                                          "pose.orientation.z", "velocity[a]")),
    ],
)  # fmt: skip
def test_a_field_is_told_by_its_path(name, quantity, unit):
    assert (meaning(name) or (None, None))[:2] == (quantity, unit)


def topics(**fields):
    """Topics of one field each: stamps (ns), then the values."""
    stamps = 10_000_000 * np.arange(50)
    for name, values in fields.items():
        topic, _, field = name.partition("__")
        yield [topic, "", "ns"], stamps
        yield [topic, field.replace("_", "."), ""], np.asarray(values, float)


def test_the_axis_that_moves_is_taken_and_a_second_one_as_large_is_refused(tmp_path):
    rise = np.linspace(0.0, 1.0, 50)
    fields = {"a__wrench_force_x": 0.1 * rise, "b__wrench_force_z": rise,
              "c__pose_position_y": 1e-3 * rise, "d__position_1": rise}  # fmt: skip
    (found,) = of_topics(list(topics(**fields)), tmp_path)
    assert (found.load.name, found.way.name) == ("b.wrench.force.z", "c.pose.position.y")
    assert found.way.values[-1] == pytest.approx(1.0)  # mm
    with pytest.raises(InputError, match=r"b.wrench.force.z \(1\)"):
        of_topics(list(topics(**fields, e__wrench_force_y=0.9 * rise)), tmp_path)
    with pytest.raises(InputError, match="no force that changes"):
        of_topics(list(topics(c__pose_position_y=rise)), tmp_path)


def test_a_bag_without_its_library_is_refused_with_the_command_that_installs_it(
    tmp_path, monkeypatch
):
    (tmp_path / "a.mcap").write_bytes(MCAP + bytes(100))
    monkeypatch.setattr(binary, "find_spec", lambda module: None)
    with pytest.raises(InputError, match=r"pip install 'qlvbayes\[ros\]'"):
        convert([tmp_path / "a.mcap"])


ROS_1_AND_2 = pytest.mark.parametrize("made", ["mcap", "bag"])


@ROS_1_AND_2
@pytest.mark.few(1)
def test_a_bag_that_is_damaged_or_of_a_joint_without_a_unit_is_refused(tmp_path, made):
    path = bag(tmp_path, made)
    path.write_bytes(path.read_bytes()[:20_000])
    with pytest.raises(InputError, match="cut off or damaged"):
        convert([path])
    path = bag(tmp_path, made)
    with pytest.raises(UnsureError, match="unit"):
        convert([path])
    (test,) = convert([path], Answers.from_words(units="s,m,N")).tests
    assert test.units.displacement == "m"
    assert np.ptp(test.displacement) == pytest.approx(1e-3 * np.ptp(STORED.way), rel=0.01)
