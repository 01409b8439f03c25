"""Logs of robots: which of many channels is force and which displacement, by which clock."""

import numpy as np
import pytest
from support.endtoend import call, one_line
from support.machine_files import CORPUS, STORED, of_layout

from qlvbayes.io import binary
from qlvbayes.io.binary import RosChannel, meaning, recording_of
from qlvbayes.io.checks import InputError
from qlvbayes.io.conversion import convert
from qlvbayes.io.loading import Answers
from qlvbayes.io.recording import UnsureError

TEST = STORED
EPOCH = 1_750_000_000  # s since 1970, of a robot's clock
MCAP = b"\x89MCAP0\r\n"


def bag(folder, suffix):
    pytest.importorskip("rosbags", reason="rosbags is not installed: no bag is read")
    path = folder / "log.mcap"
    path.write_bytes((CORPUS / "other" / f"joints.{suffix}").read_bytes())
    return path


def channel(name, values, start=0.0):
    return RosChannel(name, start + 0.01 * np.arange(len(values)), np.asarray(values, float))


@pytest.mark.parametrize(
    ("name", "quantity", "unit"),
    [
        ("wrench.force.z", "force", "N"),
        ("/ft_sensor/wrench/force/z", "force", "N"),
        (".pose.position.x", "displacement", "mm"),
        ("/tf.transform.translation.y", "displacement", "mm"),
        ("/joint_states.position[slide]", "displacement", ""),
        ("/joint_states/slide/position", "displacement", ""),
        ("/rig/displacement_um.data", "displacement", "um"),
        ("/cell/force.data", "force", ""),
    ],
)
def test_a_field_is_told_by_its_path(name, quantity, unit):
    assert (meaning(name).quantity, meaning(name).unit) == (quantity, unit)


@pytest.mark.parametrize(
    "name", ["wrench.torque.z", "header.stamp.sec", "pose.orientation.z", "/t.data", "velocity[a]"]
)
def test_other_fields_are_neither_force_nor_displacement(name):
    assert meaning(name) is None


def test_the_axis_that_moves_is_taken_and_a_second_one_as_large_is_refused(tmp_path):
    rise = np.linspace(0.0, 1.0, 50)
    small = 0.1 * rise
    channels = [
        channel("/ft.wrench.force.x", small),
        channel("/ft.wrench.force.z", rise),
        channel("/tool.pose.position.x", 0.0 * rise),
        channel("/tool.pose.position.y", 1e-3 * rise),
        channel("/joints.position[a]", rise),  # a point is preferred to a joint
    ]
    found = recording_of(channels, tmp_path, 0.0)
    assert (found.load.name, found.way.name) == ("/ft.wrench.force.z", "/tool.pose.position.y")
    assert found.way.values[-1] == pytest.approx(1.0)  # mm
    with pytest.raises(InputError, match=r"/ft.wrench.force.z \(1\) and /ft.wrench.force.y"):
        recording_of([*channels, channel("/ft.wrench.force.y", 0.9 * rise)], tmp_path, 0.0)
    with pytest.raises(InputError, match="no force that changes"):
        recording_of(channels[2:], tmp_path, 0.0)


def test_each_topic_keeps_its_own_stamps(tmp_path):
    """The position is stamped 20 ms later than the force of the same row: it is brought back."""
    time = np.arange(0.0, 2.0, 0.01)
    force = RosChannel("/a.wrench.force.z", time, time.copy())
    place = RosChannel("/b.pose.position.z", time + 0.02, 1e-3 * (time + 0.02))
    found = recording_of([force, place], tmp_path, 0.0)
    assert np.allclose(found.way.values, found.load.values)
    assert found.dropped == {"rows of the force outside the displacement's clock": 2}
    swapped = np.r_[1, 0, 2 : len(time)]
    late = RosChannel(force.name, force.time[swapped], force.values[swapped])
    again = recording_of([late, place], tmp_path, 0.0)
    assert np.array_equal(again.load.values, found.load.values)


def test_stamps_of_two_columns_and_of_nanoseconds_give_the_same_test(tmp_path):
    (tmp_path / "a.csv").write_bytes(of_layout("ros-table-b.csv").read_bytes())
    rows = zip(TEST.time, TEST.load, TEST.way, strict=True)
    text = "timestamp,wrench.force.z,pose.position.z\n" + "".join(
        f"{EPOCH * 10**9 + round(1e9 * t)},{f:.6f},{1e-3 * d:.9f}\n" for t, f, d in rows
    )
    (tmp_path / "b.csv").write_text(text)
    a, b = (convert([tmp_path / name]).tests[0] for name in ("a.csv", "b.csv"))
    assert np.allclose(a.time, b.time, atol=3e-7)  # a double holds such stamps to 256 ns
    assert np.array_equal(a.displacement, b.displacement)


def test_a_wide_table_is_looked_at_without_being_converted_first(tmp_path):
    content = of_layout("ros-table-a.csv").read_bytes()
    (tmp_path / "log.csv").write_bytes(content.replace(b"-", b""))
    status, out, err = call("look", tmp_path / "log.csv", "-o", tmp_path / "out", drawn=True)
    assert status == 0, err
    assert "wide tables made of ROS bags" in out


def test_a_bag_without_its_library_is_refused_with_the_command_that_installs_it(
    tmp_path, monkeypatch
):
    (tmp_path / "a.mcap").write_bytes(MCAP + bytes(100))
    monkeypatch.setattr(binary, "find_spec", lambda module: None)
    with pytest.raises(InputError, match=r"pip install 'qlvbayes\[ros\]'"):
        convert([tmp_path / "a.mcap"])


ROS_1_AND_2 = pytest.mark.parametrize("made", ["bag", "mcap"])


@ROS_1_AND_2
def test_a_damaged_bag_is_refused_in_one_line(tmp_path, made):
    path = bag(tmp_path, made)
    path.write_bytes(path.read_bytes()[:20_000])
    status, _, err = call("look", path, "-o", tmp_path / "out")
    assert status == 2
    assert "cut off, damaged" in one_line(err)


@ROS_1_AND_2
def test_a_joint_may_turn_or_slide_so_that_its_unit_is_asked(tmp_path, made):
    path = bag(tmp_path, made)
    with pytest.raises(UnsureError, match="unit"):
        convert([path])
    (test,) = convert([path], Answers.from_words(units="s,m,N")).tests
    assert test.units.displacement == "m"
    assert np.ptp(test.displacement) == pytest.approx(1e-3 * np.ptp(TEST.way), rel=0.01)
