"""The words of the field: each curve against its definition, not against its formula."""

import io

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad
from support.exported_pad import exported

from qlvbayes.io.checks import InputError
from qlvbayes.laws.motion import Motion
from qlvbayes.model.choices import Choices
from qlvbayes.use.exports.curves import ViscoelasticCurves, crept
from qlvbayes.use.exports.target import Geometry


def tables(pad, specimen=None):
    """Columns of both files by their names."""
    found = []
    for content in ViscoelasticCurves().files(pad, specimen).values():
        lines = [x for x in content.decode().splitlines() if not x.startswith("#")]
        rows = np.loadtxt(io.StringIO("\n".join(lines[1:])), delimiter=",")
        found.append(dict(zip(lines[0].split(","), rows.T, strict=True)))
    return found


@pytest.fixture(scope="module")
def pad(tmp_path_factory):
    return exported(tmp_path_factory.mktemp("curves"))


def left(pad, time):
    """G (T,) of the middle draw."""
    return pad.fractions[0] + np.exp(-np.outer(time, 1.0 / pad.times)) @ pad.fractions[1:]


def test_relaxation_is_the_spectrums(pad):
    relaxation, _ = tables(pad)
    assert relaxation["share_left"] == pytest.approx(left(pad, relaxation["time (s)"]), rel=1e-12)


@pytest.mark.parametrize("law", ["spline", "toe", "polynomial:3"])
@pytest.mark.few(2)
def test_the_stiffness_is_the_law_s_own(tmp_path, pad, law):
    """Two pads of one relaxation differ in it alone, also where a law has a fixed field."""
    other = exported(tmp_path, Choices(elastic=law), spread=0.0)
    own, stiff = (tables(one)[1]["storage (N/mm)"] / one.stiffness(0.0) for one in (other, pad))
    assert own == pytest.approx(stiff, rel=0.1)  # the draws of the other pad are 2 % apart


@pytest.mark.parametrize("relaxation", ["prony", "power-law"])
def test_creep_under_the_compliance_takes_one_unit_of_force(tmp_path, relaxation):
    """The hereditary integral of J, by trapezoids on ever finer steps, is one."""
    pad = exported(tmp_path, Choices(relaxation=relaxation))
    found, _ = tables(pad)
    at = found["time (s)"]
    time = np.concatenate([[0.0], np.geomspace(1e-6, at[-1], 20_001)])
    stiffness = pad.stiffness(0.0)
    jump = 1.0 / stiffness
    # between the table's rows J is smooth in the logarithm of time; before them it is the table's
    creep = crept(pad.middle, time)[0] / stiffness
    assert np.interp(at, time, creep) == pytest.approx(found["creep_compliance (mm/N)"], rel=1e-6)
    assert creep[0] == pytest.approx(jump)
    middle = 0.5 * (time[1:] + time[:-1])
    for end in (5000, 12_000, 20_001):
        lasting = left(pad, time[end] - middle[:end])
        force = stiffness * (
            jump * left(pad, time[end : end + 1])[0] + lasting @ np.diff(creep)[:end]
        )
        assert force == pytest.approx(1.0, abs=2e-6)


def test_storage_and_loss_are_the_transforms_of_relaxation(pad):
    _, dynamic = tables(pad)
    for row in (0, 30, 60):
        omega = 2.0 * np.pi * dynamic["frequency (Hz)"][row]
        rest = pad.fractions[0]

        def fades(time):
            return left(pad, np.array([time]))[0] - rest  # noqa: B023

        sine, cosine = (
            quad(fades, 0.0, np.inf, weight=kind, wvar=omega, limlst=500)[0]
            for kind in ("sin", "cos")
        )
        stiffness = pad.stiffness(0.0)
        storage, loss = dynamic["storage (N/mm)"][row], dynamic["loss (N/mm)"][row]
        assert storage == pytest.approx(stiffness * (rest + omega * sine), rel=1e-6)
        assert loss == pytest.approx(stiffness * omega * cosine, rel=1e-5)
        assert dynamic["tan_delta"][row] == pytest.approx(loss / storage, rel=1e-12)


def test_a_cycle_loses_what_its_loop_encloses(tmp_path):
    """The loss is that of the model's force over the last cycle of small sines about contact."""
    pad = exported(tmp_path, Choices(bonded=True))
    _, dynamic = tables(pad)
    row, amplitude, cycles = 30, 1e-4, 20
    omega = 2.0 * np.pi * dynamic["frequency (Hz)"][row]
    time = np.linspace(0.0, cycles * 2.0 * np.pi / omega, 400 * cycles + 1)
    depth, speed = amplitude * np.sin(omega * time), amplitude * omega * np.cos(omega * time)
    force = pad.model.force(Motion(*map(jnp.asarray, (time, depth, speed, 0.0 * time))))
    last = np.trapezoid(np.asarray(force)[-401:], depth[-401:])
    assert dynamic["lost_in_a_cycle (N/mm)"][row] == pytest.approx(last / amplitude**2, rel=5e-3)


def test_bands_hold_the_middle_and_a_shape_makes_moduli(pad):
    for table in tables(pad):
        for name in table:
            plain, _, unit = name.partition(" ")
            tail = f" {unit}" if unit else ""
            if f"{plain}_low{tail}" in table:
                assert np.all(table[f"{plain}_low{tail}"] < table[name])
                assert np.all(table[name] < table[f"{plain}_high{tail}"])
    plain, block = tables(pad)[1], tables(pad, Geometry(height=10.0, area=200.0))[1]
    assert block["storage (MPa)"] == pytest.approx(plain["storage (N/mm)"] * 10.0 / 200.0)
    assert block["tan_delta"] == pytest.approx(plain["tan_delta"])
    for part in ("storage", "loss"):
        ratio = block[f"{part} (MPa)"] / block[f"shear_{part} (MPa)"]
        assert ratio == pytest.approx(2.99)  # of a Poisson's ratio of 0.495
    assert not any(name.startswith("shear") for name in plain)


def test_what_has_no_stiffness_at_first_contact_is_refused(tmp_path):
    with pytest.raises(InputError, match="hertz has no stiffness at first contact"):
        ViscoelasticCurves().files(exported(tmp_path, Choices(elastic="hertz")), None)
