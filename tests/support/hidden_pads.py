"""Simulated tests of a pad with effects hidden in it, made ready for a diagnosis."""

import json

import pytest
from blind.study import measured

from qlvbayes.diagnosis.summary.diagnosis import Diagnosis
from qlvbayes.effects.catalogue import find
from qlvbayes.laws.catalogue import LAWS
from qlvbayes.motion.experiment import Experiment, prepare
from qlvbayes.simulate import NOISES, TABLE_1, Constants, HiddenPad, paper_protocol, record_study

FEW = tuple(map(find, ("viscous_drag", "friction", "force_offset", "force_drift")))
"""Candidates where not all are needed: one set, so that it is traced and compiled once."""

_ROWS = 300  # a test
_LAWS_KNOWN = {law.name for law in LAWS.elastic}


def hidden_pad(
    *effects, rates, constants: Constants = TABLE_1["B"], seed=0, protocol=paper_protocol
) -> Experiment:
    """One test at each rate (mm/s), with correlated noise."""
    programs = {f"{rate:g}": protocol(rate) for rate in rates}
    pads = {"B": HiddenPad(constants, effects)}
    return prepare(measured(record_study(pads, programs, NOISES["correlated"], seed, _ROWS), "B"))


def keeps_diagnosis_contract(found: Diagnosis):
    content = json.loads(json.dumps(found.result.as_dict(), allow_nan=False))
    assert content["schema"] == 1
    assert content["steps"][0]["effects"] == []
    assert "none" in [entry["effect"] for entry in content["ranking"]]
    assert sum(entry["probability"] for entry in content["ranking"]) == pytest.approx(1.0)
    assert all(e["probability"] <= e["inclusion"] + 1e-9 <= 1.0 + 2e-9 for e in content["ranking"])
    assert content["base"]["elastic"] in _LAWS_KNOWN
    assert sum(entry["probability"] for entry in content["bases"]) == pytest.approx(1.0, abs=0.1)
    assert content["worst"]["phase"] in ("ramp", "hold", "unload", "recovery")
