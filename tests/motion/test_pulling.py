"""Force below zero on a loose specimen: where, how much, and what to ask."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from blind.study import measured

from qlvbayes.diagnosis.summary.words import _first
from qlvbayes.motion.experiment import prepare
from qlvbayes.motion.specimen import pull_notices, pull_of
from qlvbayes.simulate import NOISES, TABLE_1, HiddenPad, paper_protocol, record_study


@pytest.fixture(scope="module")
def pad():
    programs = {f"{rate:g}": paper_protocol(rate) for rate in (1.0, 20.0)}
    found = record_study({"B": HiddenPad(TABLE_1["B"])}, programs, NOISES["correlated"], 0, 500)
    return measured(found, "B")


def pulled(pad, share, test=1):
    """The same pulling by so much, over the peak of all, in the midst of one test's unloading."""
    trial, force = prepare(pad).trials[test], pad.tests[test].force.copy()
    unload = next(phase for phase in trial.phases if phase.kind == "unload")
    rows = np.flatnonzero((trial.test.time > unload.start) & (trial.test.time < unload.stop))
    sagitta = np.sin(np.linspace(0.0, np.pi, rows.size))
    force[rows] = -share * max(float(t.force.max()) for t in pad.tests) * sagitta / sagitta.max()
    tests = list(pad.tests)
    tests[test] = replace(tests[test], force=force)
    return prepare(replace(pad, tests=tuple(tests)))


def test_noise_about_zero_is_no_pull(pad):
    assert pull_of(prepare(pad)) is None
    assert pull_notices(pulled(pad, 0.03), bonded=False) == ()


@pytest.mark.parametrize("test", [0, 1])
def test_the_lowest_pull_is_told_with_test_time_and_size_unless_the_specimen_may(pad, test):
    experiment = pulled(pad, 0.08, test)
    found, trial = pull_of(experiment), experiment.trials[test]
    assert found.test == trial.name
    assert found.time == trial.test.time[int(np.argmin(trial.test.force))]
    assert found.share == pytest.approx(0.08, rel=1e-6)
    (text,) = pull_notices(experiment, bonded=False)
    for part in (found.test, f"{found.force:.3g} N", f"{found.time:.4g} s", "8 %", "--bonded"):
        assert part in text
    assert "adhesion" in text
    assert "\n" not in text
    assert pull_notices(experiment, bonded=True) == ()
    assert pull_notices(experiment, bonded=False, effects=("adhesion",)) == ()
    assert len(pull_notices(experiment, bonded=False, effects=("inertia",))) == 1


@pytest.mark.parametrize(("named", "asked"), [((), True), (("adhesion",), False)])
def test_what_to_do_next_begins_with_a_pull_that_has_no_name(pad, named, asked):
    notices = pull_notices(pulled(pad, 0.08), bonded=False)
    found = SimpleNamespace(pad="B", effects=named, stages=(SimpleNamespace(effects=()),))
    said = _first(found, notices)
    assert said.startswith("say first how the specimen is held, for the measured force") is asked
    assert ("--bonded" in said) is asked
    assert _first(found, ()) == ""
