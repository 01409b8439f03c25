"""Blind studies of the paper's strata: population, stored studies, coverage, what is written."""

import json

import numpy as np
import pytest
from blind.case import run_case
from blind.constants import coverage, named_as_fitted, true_values
from blind.counting import COUNTS, Rate, counted
from blind.laws import Law
from blind.population import PAPER_STRATA, STRATA, Population, kin
from blind.study import SIZES, make_study

from qlvbayes.io.checks import InputError

TRUE_M = 0.5
LAWS = ["exponential", "prony:2"]
LAW = {
    "elastic": LAWS[0], "curve": [TRUE_M, 0.8], "relaxation": LAWS[1],
    "fading": [0.4, 6.0, 0.2, 0.2],
}  # fmt: skip


def stage(heldout_rmse, m=TRUE_M, effects=()):
    found = {"effects": list(effects), "rmse": heldout_rmse, "heldout_rmse": heldout_rmse}
    return found | {"base": LAWS, "p_value": 0.5, "parameters": {"m": [m, 0.01]}}


def case(
    kind="single",
    names=("viscous_drag",),
    verdict="missing_effect",
    effects=("viscous_drag",),
    group=(),
    seen=True,
    index=0,
    m=TRUE_M,
):
    """A finished study; by default one whose only effect was found."""
    population = Population(0, paper=True)
    return {
        "plan": population.key,
        "code": "abc",
        "index": index,
        "strata": population.item(index).levels | {"kind": kind},
        "kind": kind,
        "names": list(names),
        "kin": {name: sorted(kin(name)) for name in names},
        "seen": seen,
        "seconds": {"simulate": 1.0, "diagnose": 2.0},
        "law": LAW,
        "floor": 0.01,
        "verdict": verdict,
        "effects": list(effects),
        "group": list(group),
        "probabilities": {"none": 0.1, "viscous_drag": 0.9, "inertia": 0.05},
        "stages": [stage(0.03, m=TRUE_M + 0.05), stage(0.01, m=m)],
    }


def nothing(verdict="adequate", **more):
    effects = more.pop("effects", ())
    return case(kind="none", names=(), verdict=verdict, effects=effects, **more)


def test_the_papers_population_hides_only_the_chosen_effects():
    assert set(PAPER_STRATA) == set(STRATA)
    population = Population(0, paper=True, effects=("friction", "inertia"))
    items = [population.item(index) for index in range(40)]
    alone = {item.names[0] for item in items if item.levels["kind"] == "single"}
    assert alone == {"friction", "inertia"}
    assert population.key != Population(0, paper=True).key
    with pytest.raises(InputError, match="no effect 'rust'"):
        Population(0, effects=("rust",))
    with pytest.raises(InputError, match="no noise"):
        Population(0, noise="pink")


def index_of(population, kind):
    return next(k for k in range(20) if population.item(k).levels["kind"] == kind)


def test_a_study_is_drawn_within_its_ranges():
    population = Population(0, paper=True, noise="white", effects=("force_offset",))
    study = make_study(population, index_of(population, "single"))
    low, high = SIZES
    assert [effect.name for effect in study.effects] == ["force_offset"]
    assert all(low <= size <= high for size in study.sizes)
    assert (study.law.elastic, study.law.relaxation) == tuple(LAWS)
    assert len(study.pad.tests) == 6
    assert all(test.time.size <= 350 for test in study.pad.tests)
    assert abs(study.effects[0].offset) / study.peak == pytest.approx(study.sizes[0], rel=0.2)
    assert study.cell.white > 0.0 == study.cell.correlated


def test_a_program_that_stops_is_stored_as_a_failure(monkeypatch):
    def broken(*_):
        raise RuntimeError("no way")

    monkeypatch.setattr("blind.case.prepare", broken)
    population = Population(0, paper=True)
    found = run_case(population, index_of(population, "none"))
    assert found["verdict"] == "failed"
    assert "no way" in found["error"]
    (failed,) = (count for count in COUNTS if count.name == "failed")
    assert counted([found, nothing(index=1)], failed) == Rate(1, 2)
    json.dumps(found, allow_nan=False)


def test_rates_have_binomial_errors_and_truth_the_names_of_a_fit():
    assert Rate(50, 100).error == pytest.approx(0.05)
    assert Rate(100, 100).error > 0.0
    assert str(Rate(0, 0)) == "-"
    values = true_values(Law(**LAW))
    assert list(values) == ["m", "b", "c[0]", "c[1]", "c[2]", "v[1]", "v[2]"]
    assert values["c[0]"] == pytest.approx(1.0 - 0.4 - 0.2)
    assert values["v[1]"] == 6.0


def test_coverage_is_of_the_papers_constants():
    found = coverage([case(m=TRUE_M + 0.016), case(m=TRUE_M + 0.017), case(seen=False)])
    assert found["m"].before == Rate(0, 2)
    assert found["m"].after == Rate(1, 2)
    assert found["m"].error_before == pytest.approx(5.0)
    assert found["all"].after == Rate(1, 2)
    other = case() | {"law": LAW | {"elastic": "hertz", "curve": [1.0]}}
    assert not coverage([other])
    changed = case()
    changed["stages"][-1]["base"] = ["hertz", LAWS[1]]
    assert not coverage([changed])
    off = case(verdict="ambiguous", m=TRUE_M + 0.03)
    assert coverage([off])["m"].after == Rate(0, 1)
    assert coverage([off | {"found": {"m": [TRUE_M + 0.02, 0.02]}}])["m"].after == Rate(1, 1)


def relaxation(c, v, shares, rates, t):
    """A pad's modes and an extra one."""
    own = shares[0] + sum(s * np.exp(-r * t) for s, r in zip(shares[1:], rates, strict=True))
    return (1.0 - c) * own + c * np.exp(-v * t)


@pytest.mark.parametrize(("v", "fitted"), [(2.0, (9.0, 2.1, 0.3)), (0.1, (11.0, 0.1, 0.4))])
def test_modes_that_changed_names_are_the_same_relaxation(v, fitted):
    truth = {"m": 0.2, "c[0]": 0.5, "c[1]": 0.3, "c[2]": 0.2, "v[1]": 10.0, "v[2]": 0.4}
    hidden = {"c": 0.1, "v": v}
    rates = {"v[1]": fitted[0], "v[2]": fitted[1], "extra_relaxation_mode.v": fitted[2]}
    found = named_as_fitted(truth, hidden, rates)
    assert (found["m"], found["v[1]"], found["v[2]"]) == (0.2, 10.0, v)
    t = np.linspace(0.0, 20.0, 50)
    before = relaxation(0.1, v, (0.5, 0.3, 0.2), (10.0, 0.4), t)
    shares = [found[f"c[{k}]"] for k in range(3)]
    assert sum(shares) == pytest.approx(1.0)
    extra = 0.2 * 0.9  # the pad's slow mode has become the extra one
    np.testing.assert_allclose(relaxation(extra, 0.4, shares, (10.0, v), t), before)
    kept = {"v[1]": 9.0, "v[2]": 0.5, "extra_relaxation_mode.v": 1.5}
    assert named_as_fitted(truth, {"c": 0.1, "v": 2.0}, kept) == pytest.approx(truth)
