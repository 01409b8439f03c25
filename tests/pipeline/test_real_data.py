"""Measurements by others: muscle in tension, an adhesive in shear (skipped where absent)."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from support.endtoend import call, keeps_check_contract, keeps_summary_contract, read_json

from qlvbayes.io.data import read_measurements
from qlvbayes.motion.experiment import prepare

REAL = Path(__file__).parents[3] / "shared" / "real"
MUSCLE, ADHESIVE = REAL / "muscle_ramps.csv", REAL / "adhesive_shear.csv"

pytestmark = pytest.mark.skipif(not REAL.is_dir(), reason="the measurements are not here")


@cache
def ready(data, name):
    return prepare(read_measurements(data).pad(name))


def noted(err):
    """Return whether nothing but notices was printed."""
    return all(line.startswith("notice: pad ") for line in err.splitlines())


def fit_and_check(folder, data, pad, *words):
    """Summary and check of one pad, in this process."""
    for step in (("fit", data, "-o", folder, "--pads", pad, *words), ("check", folder)):
        status, _, err = call(*step)
        assert (status, noted(err)) == (0, True), err
    summary, checked = (read_json(folder / pad / f"{name}.json") for name in ("summary", "check"))
    keeps_summary_contract(summary)
    keeps_check_contract(checked)
    return summary, checked


@pytest.fixture(scope="module")
def muscle(tmp_path_factory):
    return fit_and_check(tmp_path_factory.mktemp("muscle"), MUSCLE, "calcium")


@pytest.mark.slow
def test_muscle_is_in_kpa_and_converges_to_the_order_of_its_stress(muscle):
    summary, _ = muscle
    assert summary["converged"] is True
    units = {name: p["unit"] for name, p in summary["parameters"].items()}
    assert units["m"] == units["noise.white"] == "kPa"
    assert (units["b"], units["v[1]"], units["noise.tau"]) == ("1", "1/s", "s")
    # separable and linear, the model cannot follow muscle over all rates; on the one it does
    _, checked = muscle
    peak = max(np.max(t.force) for t in read_measurements(MUSCLE).pad("calcium").tests)
    fitted = [c["rmse_N"] for c in checked["cells"] if c["role"] == "fit"]
    assert max(fitted) < 0.1 * peak
    assert max(c["rmse_N"] for c in checked["cells"]) < 0.5 * peak


def test_muscles_measured_sds_weigh_its_samples():
    experiment = ready(MUSCLE, "calcium")
    record = experiment.record(experiment.with_role("fit"))
    weight = np.asarray(record.blocks.weight)[np.asarray(record.blocks.real)]
    (trial,) = experiment.with_role("fit")
    assert np.ptp(weight) > 0.2
    ratio = trial.test.force_sd.max() / trial.test.force_sd.min()
    assert 1.0 < weight.max() / weight.min() <= ratio * (1.0 + 1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(("data", "pads"), [(MUSCLE, 3), (ADHESIVE, 2)])
def test_every_pad_has_phases_and_a_noise_floor(data, pads):
    found = read_measurements(data).pads
    assert len(found) == pads
    for pad in found:
        experiment = ready(data, pad.name)
        assert 0.0 < experiment.floor.total < 0.05 * experiment.peak
        assert len(experiment.with_role("fit")) >= 1
        for trial in experiment.trials:
            assert {"ramp", "hold"} <= {phase.kind for phase in trial.phases}


@pytest.mark.slow
def test_no_effect_of_the_list_explains_muscle_with_calcium(tmp_path):
    status, _, err = call("diagnose", MUSCLE, "-o", tmp_path, "--pads", "calcium", "--json")
    assert (status, noted(err)) == (0, True), err
    found = read_json(tmp_path / "calcium" / "diagnosis.json")
    assert found["verdict"] == "unexplained"
    assert found["effects"] == []
    assert found["discrepancy_sd_N"] > found["noise_N"]
    unseen = {entry["effect"]: entry["reason"] for entry in found["not_identifiable"]}
    assert unseen["stress_softening"] == "no test unloads"
    assert (tmp_path / "calcium" / "discrepancy.csv").stat().st_size > 1000
