"""Every target says what it must; what finite elements get is read back and relaxes as g does."""

import io
import json
import zipfile
from xml.etree import ElementTree

import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest
from scipy.special import exp1
from support.endtoend import call
from support.exported_pad import DATE, RELAXATION, TESTED, exported, write_fit
from support.written_results import diagnosis, write

from qlvbayes.io.checks import InputError
from qlvbayes.model.choices import Choices
from qlvbayes.use.exports.finite_elements import POISSON, Abaqus, FEBio, PronyTable
from qlvbayes.use.exports.json_file import JsonFile
from qlvbayes.use.exports.pad import read_pad
from qlvbayes.use.exports.target import TARGETS, Geometry, find

EXACT = 1e-12
BLOCK = Geometry(height=10.0, area=200.0)
YOUNG = 10.0 / 200.0  # MPa, of a stiffness of 1 N/mm
TIMES = np.concatenate([[0.0], np.geomspace(1e-4, 1e3, 60)])


def text_of(files):
    """All that is said in a target's files."""
    parts = []
    for name, content in files.items():
        if not name.endswith(".fmu"):
            parts.append(content.decode())
            continue
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            read = [x for x in archive.namelist() if not x.endswith(".so")]
            parts += [archive.read(x).decode() for x in read]
    return " ".join("\n".join(parts).split())


def assert_relaxes_like(pad, fractions, times):
    assert np.sum(fractions) == pytest.approx(1.0, abs=EXACT)
    g = fractions[0] + np.exp(-TIMES[:, None] / np.asarray(times)) @ np.asarray(fractions[1:])
    assert np.max(np.abs(g - np.asarray(pad.relaxation.curve(jnp.asarray(TIMES))))) <= EXACT


@pytest.fixture(scope="module")
def pads(tmp_path_factory):
    """Give a pad of each model, once."""
    known = {}

    def build(law="exponential", relaxation="prony", source="data/pads.csv", **options):
        key = law, relaxation, source
        if key not in known:
            choices = Choices(elastic=law, relaxation=relaxation, **options)
            known[key] = exported(tmp_path_factory.mktemp("pad"), choices, source=source)
        return known[key]

    return build


@pytest.mark.parametrize(("verdict", "told"), [("partly_explained", True), ("adequate", False)])
def test_a_model_that_a_diagnosis_found_wanting_says_so(tmp_path, verdict, told):
    write_fit(tmp_path)
    write(tmp_path / "B" / "diagnosis.json", diagnosis("B", verdict))
    pad = read_pad(tmp_path, "B", draws=2, date=DATE)
    assert ("more is there than" in text_of(find("c")().files(pad, BLOCK))) is told


@pytest.mark.parametrize("target", TARGETS, ids=lambda target: target.name)
def test_every_target_says_units_date_range_intervals_and_limits(pads, target):
    """And of the file that was fitted its name, not where it lies on this machine."""
    pad = pads(source="/home/me/secret/pads.csv", effects=("viscous_drag",))
    said = text_of(target().files(pad, BLOCK))
    for words in ("displacement mm", "force N", DATE, "1.6 mm", "0.1 to 40 mm/s", "30 s, 6 tests"):
        assert words in said
    assert "pads.csv" in said
    assert "secret" not in said
    for x in pad.intervals:
        assert f"{x.name} = {x.median:.6g} ({x.low:.6g} to {x.high:.6g})" in said
        assert x.low < x.median < x.high
    lost = () if target.steps else (f"viscous_drag: {target.without_steps}",)
    assert ("Effect viscous_drag: F += eta v" in said) == target.steps
    for line in (*target.cannot, *lost):
        assert " ".join(line.split()) in said.replace("&#39;", "'").replace("&#x27;", "'")
    one = "one draw only" in said
    assert one != (target.name in {"c", "fmu", "mujoco", "json", "curves"})


MATERIALS = [Abaqus, FEBio, PronyTable]


@pytest.mark.parametrize("target", MATERIALS, ids=lambda target: target.name)
def test_materials_say_that_a_pad_is_a_structure(pads, target):
    assert "a fluid-filled pad is a structure" in text_of(target().files(pads(), BLOCK))
    with pytest.raises(InputError, match="--height MM and --area MM2"):
        target().files(pads(), None)
    with pytest.raises(InputError, match="stiffness"):
        target().files(pads("hertz"), BLOCK)
    if target is FEBio:
        for relaxation in ("stretched", "log-normal"):
            with pytest.raises(InputError, match="6 modes"):
                target().files(pads(relaxation=relaxation), BLOCK)


@pytest.mark.parametrize("relaxation", ["prony", *RELAXATION])
@pytest.mark.parametrize("law", ["linear", "exponential"])
@pytest.mark.few(5)
def test_abaqus(pads, law, relaxation):
    pad = pads(law, relaxation)
    text = Abaqus().files(pad, BLOCK)["pad_B.inp"].decode()
    lines = [line for line in text.splitlines() if not line.startswith("**")]
    assert lines[0] == "*MATERIAL, NAME=PAD_B"
    first, second = (float(x) for x in lines[2].split(","))
    young = YOUNG * float(pad.elastic.m)
    if law == "linear":
        assert lines[1] == "*ELASTIC, MODULI=INSTANTANEOUS"
        assert first == pytest.approx(young, rel=EXACT)
        assert second == POISSON
    else:
        assert lines[1] == "*HYPERELASTIC, NEO HOOKE, MODULI=INSTANTANEOUS"
        # what the manual calls mu0 = 2 C10 and K0 = 2/D1, at small strain
        shear, bulk = 2.0 * first, 2.0 / second
        assert 9 * bulk * shear / (3 * bulk + shear) == pytest.approx(young, rel=EXACT)
    assert lines[3] == "*VISCOELASTIC, TIME=PRONY"
    g, k, tau = np.array([[float(x) for x in line.split(",")] for line in lines[4:]]).T
    assert np.all(k == 0.0)
    assert_relaxes_like(pad, [1.0 - np.sum(g), *g], tau)


@pytest.mark.parametrize("relaxation", ["prony", "fung", "power-law"])
def test_febio_writes_g0_and_has_continuous_spectra_of_its_own(pads, relaxation):
    """Their closed forms; our spectrum is within 1e-6 of them."""
    pad = pads(relaxation=relaxation)
    root = ElementTree.fromstring(FEBio().files(pad, BLOCK)["pad_B.feb"])
    material, time, own = root.find("Material/material"), TIMES[1:], pad.relaxation
    number = {child.tag: float(child.text) for child in material.iter() if child.text.strip()}
    young = YOUNG * float(pad.elastic.m)
    if relaxation == "prony":
        assert material.get("type") == "viscoelastic"
        assert "g3" not in number
        shares, times = [number[f"g{i}"] for i in range(3)], [number[f"t{i}"] for i in (1, 2)]
        assert_relaxes_like(pad, shares, times)
        assert number["E"] == pytest.approx(young, rel=EXACT)
        return
    stays, bond = (float(material.find(f"{x}/E").text) for x in ("elastic", "bond"))
    assert stays + bond == pytest.approx(young, rel=EXACT)
    kind = material.find("relaxation").get("type")
    if relaxation == "fung":
        assert (kind, number["beta"]) == ("relaxation-Malkin", 1.0)
        t1, t2 = number["tau1"], number["tau2"]
        falls = (exp1(time / t2) - exp1(time / t1)) / np.log(t2 / t1)
        c, low, high = float(own.c), float(own.tau1), float(own.tau2)
        exact = 1 + c * (exp1(time / high) - exp1(time / low))
        exact /= 1 + c * np.log(high / low)
    else:
        assert kind == "relaxation-power"
        falls = (1 + time / number["tau"]) ** -number["beta"]
        c0, tau, alpha = float(own.c0), float(own.tau), float(own.alpha)
        exact = c0 + (1 - c0) * (1 + time / tau) ** -alpha
    g = (stays + bond * falls) / (stays + bond)
    assert np.max(np.abs(g - exact)) <= EXACT
    assert np.max(np.abs(g - np.asarray(own.curve(jnp.asarray(time))))) <= 3e-6


@pytest.mark.parametrize("relaxation", ["prony", *RELAXATION])
def test_the_prony_table_relaxes_like_the_pad_in_both_forms(pads, relaxation):
    pad = pads(relaxation=relaxation)
    files = PronyTable().files(pad, BLOCK)
    read = json.loads(files["pad_B_prony.json"])
    table = pd.read_csv(io.BytesIO(files["pad_B_prony.csv"]), comment="#")
    assert list(table) == ["g", "G (Pa)", "K (Pa)", "tau (s)"]
    share, shear, bulk, tau = table.to_numpy().T
    assert tau[0] == np.inf
    assert_relaxes_like(pad, share, tau[1:])
    assert_relaxes_like(pad, shear / np.sum(shear), tau[1:])
    assert not np.any(bulk[1:])  # the volume does not relax
    total = np.sum(shear)
    young = 9 * bulk[0] * total / (3 * bulk[0] + total)
    assert young == pytest.approx(1e6 * YOUNG * float(pad.elastic.m), rel=EXACT)
    assert read["fast_limit"]["poisson"] == POISSON
    stated = [read["fast_limit"][key] for key in ("E_Pa", "G_Pa", "K_Pa")]
    assert stated == pytest.approx([young, total, bulk[0]], rel=EXACT)
    rows = [[term[key] for key in ("g", "G_Pa", "K_Pa", "tau_s")] for term in read["terms"]]
    assert rows[0].pop() is None
    assert rows[0] == [share[0], shear[0], bulk[0]]
    assert np.array_equal(rows[1:], table.to_numpy()[1:])


@pytest.mark.parametrize("units", [("1", "kPa"), ("1", "Pa")])
@pytest.mark.few(1)
def test_stress_over_strain_is_a_modulus_already_and_stiffness_is_one_in_any_units(tmp_path, units):
    stiff = {"mm": {}, "um": {"units": ("um", "mN")}}  # 1 mN/um = 1 N/mm
    linear = [exported(tmp_path / k, Choices(elastic="linear"), **x) for k, x in stiff.items()]
    files = [PronyTable().files(pad, BLOCK)["pad_B_prony.json"] for pad in linear]
    young = [json.loads(x)["fast_limit"]["E_Pa"] for x in files]
    assert young[0] == pytest.approx(young[1], rel=EXACT)
    pad = exported(tmp_path, Choices(bonded=True), units=units)
    read = json.loads(PronyTable().files(pad, None)["pad_B_prony.json"])
    size = {"kPa": 1e3, "Pa": 1.0}[units[1]]
    assert read["fast_limit"]["E_Pa"] == pytest.approx(size * float(pad.elastic.m), rel=EXACT)
    assert "structure" not in " ".join(read["card"])
    for target in ("drake", "mujoco"):
        with pytest.raises(InputError, match="strain and stress"):
            find(target)().files(pad, None)


def test_json_loses_nothing(pads):
    pad = pads("polynomial:3", "fung")
    read = json.loads(JsonFile().files(pad, None)["pad_B.json"])
    assert read["units"] == {"displacement": "mm", "force": "N"}
    assert read["covered"] == TESTED
    assert len(read["draws"]) == 16
    for rows, draws in (([read["closest_to_median"]], pad.middle), (read["draws"], pad.table)):
        assert np.array_equal([list(x["elastic"].values()) for x in rows], draws.elastic)
        assert np.array_equal([x["c"] for x in rows], draws.fractions)
        assert np.array_equal([x["v"] for x in rows], draws.rates)
    assert list(rows[0]["elastic"]) == ["m", "k2", "k3"]
    best = read["closest_to_median"]
    assert_relaxes_like(pad, best["c"], 1.0 / np.array(best["v"]))
    # draws scatter by 2 %: of 200 the closest is within one sd of every median
    medians = np.array([x.median for x in pads().intervals])
    middle = pads().middle
    closest = np.concatenate([middle.elastic[0], middle.fractions[0], middle.rates[0]])
    assert np.max(np.abs(closest / medians - 1.0)) < 0.02


def test_a_range_that_is_not_known_is_told_or_refused(tmp_path):
    pad = exported(tmp_path, covered=None)
    assert "does not say which depths" in text_of(find("c")().files(pad, None))
    with pytest.raises(InputError, match="tested"):
        find("drake")().files(pad, None)


def test_the_command_writes_each_target_into_a_folder_with_the_summarys_intervals(tmp_path):
    write_fit(tmp_path)
    words = ("export", tmp_path, "--pad", "B", "--to", "c,json", "--draws", "5", "--json")
    status, out, err = call(*words)
    assert (status, err) == (0, "")
    folder = tmp_path / "B" / "export"
    assert json.loads(out) == {
        "c": [str(folder / "c" / "pad_B.h"), str(folder / "c" / "pad_B_draws.h")],
        "json": [str(folder / "json" / "pad_B.json")],
    }
    assert "#define PAD_B_DRAWS 5" in (folder / "c" / "pad_B_draws.h").read_text()
    interval = {"unit": "x", "median": 7.0, "hdi90": [6.0, 8.0]}
    names = ["m", "b", "c[0]", "c[1]", "c[2]", "v[1]", "v[2]"]
    summary = {"parameters": dict.fromkeys(names, interval)}
    (tmp_path / "B" / "summary.json").write_text(json.dumps(summary))
    status, _, err = call("export", tmp_path, "--pad", "B", "--to", "c,febio")
    assert (status, "--height MM and --area MM2" in err) == (2, True)
    assert "= 7 (6 to 8) x" not in (folder / "c" / "pad_B.h").read_text()  # all or none
    status, _, _ = call("export", tmp_path, "--pad", "B", "--to", "c")
    assert status == 0
    text = (tmp_path / "B" / "export" / "c" / "pad_B.h").read_text()
    assert text.count("= 7 (6 to 8) x") == len(names)
