"""The learning of the first guess: its regression, its registration, and its published weights."""

import json
from pathlib import Path

import numpy as np
import pytest
from ceiling import against_others
from learn_guess import logistic
from registration import FOLDER

import qlvbayes.guess.guess as package
from qlvbayes.guess.features import COMMON, OWN
from qlvbayes.guess.guess import weights


def test_the_weights_are_those_of_the_registered_run():
    registered = json.loads((FOLDER / "guess.json").read_text(encoding="utf-8"))
    assert weights().origin == {key: registered[key] for key in ("run", "seed", "pads")}
    assert len(weights().mean) == len(OWN) + len(COMMON)
    assert Path(package.__file__).with_name("weights.json").stat().st_size < 1e6


def test_the_regression_finds_what_made_the_answers_and_patterns_alike_tell_less():
    rng = np.random.default_rng(0)
    x, true = rng.normal(size=(20000, 2)), np.array([-1.0, 2.0, 0.0])
    there = (rng.random(20000) < 1.0 / (1.0 + np.exp(-true[0] - x @ true[1:]))).astype(float)
    found = logistic(x, there, np.full(2, 3.0))
    assert found == pytest.approx(true, abs=0.1)  # standard errors are 0.02 to 0.03
    design = np.column_stack([np.ones(len(x)), x])
    slope = design.T @ (1.0 / (1.0 + np.exp(-design @ found)) - there)
    assert slope == pytest.approx(-np.array([0.0, 3.0, 3.0]) * found, abs=1e-4)
    apart, alike = np.array([[3.0, 0.0], [0.0, 4.0]]), np.array([[3.0, 0.0], [4.0, 0.0]])
    assert against_others(apart) == pytest.approx([9.0, 16.0])
    assert against_others(alike) == pytest.approx([9.0 / 17.0, 16.0 / 10.0])
