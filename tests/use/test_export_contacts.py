"""Contacts of simulators: their laws are the simulators' own, and their errors those measured."""

import json
import re
import shutil
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest
from simulators import of_drake, of_mujoco
from support.endtoend import PADS, call
from support.exported_pad import exported, missed, write_fit

from qlvbayes.io.text import digest
from qlvbayes.use.exports.reduction import pressing
from qlvbayes.use.exports.simulators import Drake, MuJoCo, hunt_crossley, soft_constraint
from qlvbayes.use.exports.target import Geometry

BLOCK = Geometry(height=10.0, area=200.0)
# m, m/s: pressed, held, let go, beyond the range, and so fast that a contact would pull
PLACES = [(2e-4, 0.0), (8e-4, 0.02), (1.5e-3, 0.0), (1.5e-3, -0.01), (2e-3, 0.03), (1e-3, -20.0)]


@pytest.fixture(scope="module")
def pad(tmp_path_factory):
    """Pad B with the constants that its file was simulated with, and that file."""
    return exported(tmp_path_factory.mktemp("pad"), source=PADS, sha256=digest(PADS), spread=1e-4)


@pytest.fixture(scope="module")
def files(pad):
    return {kind.name: kind().files(pad, BLOCK) for kind in (MuJoCo, Drake)}


def errors(files, target):
    return json.loads(files[target]["pad_B_error.json"])


def geom(text):
    return ElementTree.fromstring(text).find(".//geom[@type='plane']")


@pytest.mark.parametrize("target", ["mujoco", "drake"])
def test_the_model_with_memory_is_within_two_per_cent_and_no_contact_is(files, target):
    """Errors are shares of the peak of every test and phase, those not fitted included."""
    found = errors(files, target)
    assert found["against"] == "measured"
    assert found["why_not_measured"] is None
    assert len(found["cells"]) == 24  # six tests of four phases
    assert {cell["role"] for cell in found["cells"]} == {"fit", "validate"}
    assert max(cell["rms_over_peak"]["with memory"] for cell in found["cells"]) < 0.02
    for name in set(found["whole"]) - {"with memory"}:
        assert found["whole"][name]["rms"] > 5 * found["whole"]["with memory"]["rms"]


def test_an_error_is_that_of_the_readings_themselves(files):
    """The error in a hold, where nothing moves, is stiffness times depth less the file's force."""
    found = errors(files, "drake")
    stiffness = found["numbers"]["stiffness (N/m)"]
    read = pd.read_csv(PADS, comment="#").query("test == 'B-100'")
    peak = read["force_N"].max()
    still = read[read["displacement_mm"] > 1.599]
    off = 1e-3 * stiffness * still["displacement_mm"] - still["force_N"]
    (cell,) = (x for x in found["cells"] if (x["test"], x["phase"]) == ("B-100", "hold"))
    assert cell["peak_N"] == pytest.approx(peak, rel=0.02)  # readings at the kink do not count
    plain = np.sqrt(np.mean(off**2)) / peak
    assert cell["rms_over_peak"]["point contact"] == pytest.approx(plain, rel=0.03)
    table = files["drake"]["pad_B_error.txt"].decode()
    row = f"{cell['rms_over_peak']['point contact']:.2%}"
    assert re.search(rf"B-100 +validate +hold .* {row} ", table)


def test_the_numbers_are_the_closest(pad, files):
    """No other stiffness or dissipation nearby has a smaller error against the model."""
    numbers, pressed = errors(files, "drake")["numbers"], pressing(pad)
    best = numbers["stiffness (N/m)"], numbers["dissipation (s/m)"]
    text = files["drake"]["pad_B.sdf"].decode()
    k, d = list(ElementTree.fromstring(text))[:2]
    assert (float(k.text), float(d.text)) == best
    assert k.tag.endswith("point_contact_stiffness")
    assert d.tag.endswith("hunt_crossley_dissipation")
    rms, largest, _ = missed(pressed, hunt_crossley(pressed.depth, pressed.speed, *best))
    assert f"{rms:.0%} rms and {largest:.0%} at most" in text

    def off(k, d):
        force = hunt_crossley(pressed.depth, pressed.speed, k, d)
        return np.sum(pressed.weight * (force - pressed.force) ** 2)

    for factors in ((1.01, 1.0), (0.99, 1.0), (1.0, 1.01), (1.0, 0.99)):
        assert off(*best) < off(*np.multiply(best, factors))


@pytest.mark.integration
def test_mujocos_contact_is_the_law(files):
    """The exported file in MuJoCo itself, at rest, at steady speed and accelerated."""
    pytest.importorskip("mujoco", reason="no MuJoCo here: its contact is not run")
    text = files["mujoco"]["pad_B_contact.xml"].decode()
    solref = [float(x) for x in geom(text).get("solref").split()]
    solimp = tuple(float(x) for x in geom(text).get("solimp").split())
    assert min(solref) < -100.0
    depth, speed = np.array(PLACES).T
    for acceleration in (0.0, -0.5, 2.0):
        found = of_mujoco(text, depth, speed, acceleration)
        numbers = (*np.negative(solref), solimp)
        ours = soft_constraint(depth, speed, *numbers, mass=0.1, acceleration=acceleration)
        assert found == pytest.approx(ours, rel=1e-9, abs=1e-12)


@pytest.mark.integration
@pytest.mark.parametrize("hydroelastic", [False, True], ids=["point", "hydroelastic"])
def test_drakes_contact_is_the_law(files, hydroelastic):
    """The exported properties in Drake itself, a face of the block's area on a wider pad."""
    pytest.importorskip("pydrake", reason="no Drake here: its contact is not run")
    depth, speed = np.array(PLACES).T
    text = files["drake"]["pad_B.sdf"].decode()
    shape = {"height": 1e-3 * BLOCK.height, "area": 1e-6 * BLOCK.area}
    found = of_drake(text, depth, speed, **shape, hydroelastic=hydroelastic)
    numbers = errors(files, "drake")["numbers"]
    ours = hunt_crossley(depth, speed, numbers["stiffness (N/m)"], numbers["dissipation (s/m)"])
    assert found == pytest.approx(ours, rel=1e-9, abs=1e-12)


def test_no_contact_pulls():
    depth, speed = np.array(PLACES).T
    for force in (
        hunt_crossley(depth, speed, 500.0, 2.0),
        soft_constraint(depth, speed, 500.0, 30.0, (0.01, 0.1, 1e-3, 0.5, 2.0)),
    ):
        assert np.all(force[:-1] > 0.0)
        assert force[-1] == 0.0


def test_without_the_file_the_error_is_that_against_the_model(tmp_path):
    """And says why: the file is not there, it is another one, or none was named."""
    gone, other = tmp_path / "gone.csv", shutil.copy(PADS, tmp_path / "other.csv")
    cases = {
        "one": ({"source": gone, "sha256": "0"}, "gone.csv is not where it was; --data FILE"),
        "two": ({"source": other, "sha256": "0"}, "other.csv has changed"),
        "three": ({"source": ""}, "do not say which file"),
    }
    for folder, (options, why) in cases.items():
        pad = exported(tmp_path / folder, **options)
        files = {"drake": Drake().files(pad, None)}
        found = errors(files, "drake")
        assert found["against"] == "model"
        assert why in found["why_not_measured"]
        assert why in files["drake"]["pad_B_error.txt"].decode()
        assert str(tmp_path) not in json.dumps(found)
        assert {x["rms_over_peak"]["with memory"] for x in found["cells"]} == {0.0}


def test_a_file_that_was_moved_is_named(tmp_path):
    moved = Path(shutil.copy(PADS, tmp_path / "moved.csv"))
    write_fit(tmp_path / "OUT", source=tmp_path / "gone.csv", sha256=digest(PADS))
    words = ("export", tmp_path / "OUT", "--pad", "B", "--to", "drake", "--data")
    status, _, err = call(*words, moved)
    assert (status, err) == (0, "")
    written = json.loads((tmp_path / "OUT/B/export/drake/pad_B_error.json").read_text())
    assert written["against"] == "measured"
    moved.write_text(moved.read_text().replace("B-20", "B-21"))
    status, out, err = call(*words, moved)
    assert (status, out) == (2, "")
    assert "moved.csv: not the file" in err
