"""Blind studies: the plan, one simulated study, the scores on hand-made cases, what is written."""

import json
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from blind_page import blind_page
from levels import Level, levels
from page import Origin
from typer.testing import CliRunner

from qlvbayes.cli.benchmark import benchmark, constants_table, rates_table
from qlvbayes.effects.force_offset import ForceOffset
from qlvbayes.evaluation import case as one_study
from qlvbayes.evaluation.case import run_case
from qlvbayes.evaluation.constants import constants, named_as_fitted
from qlvbayes.evaluation.detect import SEEN, Expected, expected
from qlvbayes.evaluation.keeping import Kept, code_digest, run_missing
from qlvbayes.evaluation.plan import KINDS, Plan, family
from qlvbayes.evaluation.rate import Rate
from qlvbayes.evaluation.reliability import Reliability
from qlvbayes.evaluation.report import Confusion, Report
from qlvbayes.evaluation.scores import (
    ceiling,
    heldout,
    is_left_open,
    is_right,
    is_right_or_grouped,
    names_family,
    promised,
    rates,
)
from qlvbayes.evaluation.study import SIZES, make_study
from qlvbayes.inference.amplitude_prior import log_density
from qlvbayes.io.checks import InputError
from qlvbayes.plots.benchmark import plot_benchmark
from qlvbayes.plots.files import figure_of
from qlvbayes.preprocess.experiment import prepare
from qlvbayes.simulate import FORMS, HIDDEN, OUTSIDE, GrowingDrag

TRUE_M = 0.5


def stage(heldout_rmse, m=TRUE_M, effects=()):
    found = {"effects": list(effects), "rmse": heldout_rmse, "heldout_rmse": heldout_rmse}
    return found | {"p_value": 0.5, "parameters": {"m": [m, 0.01]}}


def case(
    kind="single",
    names=("viscous_drag",),
    verdict="missing_effect",
    effects=("viscous_drag",),
    group=(),
    seen=True,
    probability=0.9,
    first=None,
    index=0,
    m=TRUE_M,
):
    """A finished study; by default one whose only effect was found."""
    first = first or (effects[0] if effects else "none")
    return {
        "plan": Plan(0).key,
        "code": "abc",
        "index": index,
        "kind": kind,
        "names": list(names),
        "protocol": "paper",
        "family": sorted(set().union(*map(family, names))),
        "seen": seen,
        "seconds": {"detect": 1.0, "diagnose": 2.0},
        "constants": {"m": TRUE_M},
        "floor": 0.01,
        "verdict": verdict,
        "effects": list(effects),
        "group": list(group),
        "probabilities": {first: probability, "other": 1.0 - probability},
        "stages": [stage(0.03, m=TRUE_M + 0.05), stage(0.01, m=m)],
    }


def nothing(verdict="adequate", **more):
    effects = more.pop("effects", ())
    return case(kind="none", names=(), verdict=verdict, effects=effects, **more)


# the plan


def test_every_kind_has_its_share_of_any_20_studies():
    plan = Plan(3)
    kinds = Counter(plan.item(index).kind for index in range(40, 60))
    assert kinds == KINDS
    first_ten = Counter(plan.item(index).kind for index in range(10))
    assert all(abs(first_ten[kind] - share / 2) < 1 for kind, share in KINDS.items())


def test_every_effect_is_hidden_equally_often_under_both_protocols():
    plan = Plan(1)
    items = [plan.item(index) for index in range(20 * len(HIDDEN))]
    for kind, known in {"single": HIDDEN, "form": FORMS, "outside": OUTSIDE}.items():
        counts = Counter(item.names[0] for item in items if item.kind == kind)
        assert set(counts) == set(known)
        assert max(counts.values()) - min(counts.values()) <= 1
    for name in HIDDEN:
        protocols = [i.protocol for i in items if i.kind == "single" and i.names == (name,)]
        assert protocols.count("paper") == protocols.count("mixed") == len(protocols) / 2
    assert abs(sum(item.protocol == "paper" for item in items) - len(items) / 2) <= 4


def test_the_plan_repeats_and_the_seed_changes_it():
    items = [Plan(5).item(index) for index in range(60)]
    assert items == [Plan(5).item(index) for index in range(60)]
    assert items != [Plan(6).item(index) for index in range(60)]


def test_two_effects_are_of_two_families():
    pairs = [item.names for item in map(Plan(0).item, range(200)) if item.kind == "double"]
    assert all(second not in family(first) for first, second in pairs)
    assert family("viscous_drag") == {"viscous_drag", "squeeze_film", "power_law_drag"}
    assert family("inertia") == {"inertia"}
    assert family("toe") == {"contact_offset"}
    assert family("slip") == set()


def test_only_the_chosen_effects_are_hidden_alone():
    plan = Plan(0, effects=("friction", "inertia"))
    items = [plan.item(index) for index in range(40)]
    assert {i.names[0] for i in items if i.kind == "single"} == {"friction", "inertia"}
    assert plan.key != Plan(0).key
    with pytest.raises(InputError, match="no effect 'rust'"):
        Plan(0, effects=("rust",))
    with pytest.raises(InputError, match="no noise"):
        Plan(0, noise="pink")


# one study


def place_of(plan, kind):
    return next(index for index in range(20) if plan.item(index).kind == kind)


@pytest.fixture(scope="module")
def study():
    plan = Plan(0, effects=("force_offset",))
    return make_study(plan, place_of(plan, "single"))


def test_a_study_repeats(study):
    plan = Plan(0, effects=("force_offset",))
    again = make_study(plan, study.item.index)
    assert again.constants == study.constants
    assert again.effects == study.effects
    for one, two in zip(study.pad.tests, again.pad.tests, strict=True):
        np.testing.assert_array_equal(one.force, two.force)


def test_a_study_is_drawn_within_its_ranges(study):
    low, high = SIZES["single"]
    assert all(low <= size <= high for size in study.sizes)
    assert [effect.name for effect in study.effects] == ["force_offset"]
    assert len(study.pad.tests) == 6
    assert all(test.time.size <= 500 for test in study.pad.tests)
    peak = max(float(test.force.max()) for test in study.pad.tests)
    offset = abs(study.effects[0].offset)
    assert offset / peak == pytest.approx(study.sizes[0], rel=0.2)


def test_a_mixed_study_goes_back_to_zero_twice():
    plan = Plan(0)
    index = next(k for k in range(20) if plan.item(k).protocol == "mixed")
    found = make_study(plan, index)
    ends = [float(test.displacement[-1]) for test in found.pad.tests]
    assert sum(abs(end) < 0.01 for end in ends) == 2
    assert sum(abs(end - 0.8) < 0.01 for end in ends) == 4


def test_expected_evidence_is_that_of_the_part_that_constants_cannot_take(study):
    ((name, found),) = expected(study, prepare(study.pad)).items()
    assert name == "force_offset"
    value = found.evidence
    assert value > SEEN
    # all of it, in white noise alone, would be more than what is left in noise of both kinds
    rows = sum(test.time.size for test in study.pad.tests)
    assert value < rows * (study.effects[0].offset / study.noise.white) ** 2


def test_the_price_is_that_of_a_normal_posterior_in_its_prior(study):
    """One amplitude, known to a/chi, in a normal prior: the integral of likelihood and prior."""
    experiment = prepare(study.pad)
    ((_, found),) = expected(study, experiment).items()
    a, prior = study.effects[0].offset, ForceOffset.default(experiment.scales).offset
    sd = abs(a) / np.sqrt(found.chi2)
    x = np.linspace(a - 9.0 * sd, a + 9.0 * sd, 2001)
    density = np.exp(-0.5 * ((x - a) / sd) ** 2 + np.array([log_density(prior, y) for y in x]))
    assert found.price == pytest.approx(-2.0 * np.log(np.trapezoid(density, x)), abs=0.1)


def test_another_form_pays_for_each_of_its_constants(study):
    """A drag that grows with depth has two."""
    hidden = replace(study, effects=(GrowingDrag(eta=1e-3, depth=0.8),))
    (found,) = expected(hidden, prepare(study.pad)).values()
    assert found.chi2 > 0.0
    assert found.price == pytest.approx(2.0 * np.log1p(found.chi2))


def test_the_chance_is_that_of_noise_on_the_square_root():
    found = Expected(chi2=20.0, price=5.0)
    z = np.sqrt(20.0) + np.random.default_rng(0).standard_normal(100_000)
    share = np.mean((z > 0.0) & (z**2 - 5.0 >= 6.0))
    assert found.evidence == 15.0
    assert found.chance(6.0) == pytest.approx(share, abs=0.005)


def test_a_program_that_stops_is_kept_as_a_failure(monkeypatch):
    def broken(*_):
        raise RuntimeError("no way")

    monkeypatch.setattr("qlvbayes.evaluation.case.prepare", broken)
    plan = Plan(0)
    found = run_case(plan, place_of(plan, "none"))
    assert found["verdict"] == "failed"
    assert "no way" in found["error"]
    report = Report.of(plan, [found, nothing(index=1)])
    assert report.rates["failed"]["all"] == Rate(1, 2)
    json.dumps(report.as_dict(), allow_nan=False)


# keeping


def test_finished_studies_are_not_run_again(tmp_path):
    ran = []

    def pretend(index):
        ran.append(index)
        return case(index=index)

    plan, path = Plan(0), tmp_path / "a" / "kept.jsonl"
    run_missing(pretend, Kept(path, plan.key), range(2))
    told = []
    run_missing(pretend, Kept(path, plan.key), range(4), lambda *done: told.append(done))
    assert ran == [0, 1, 2, 3]
    assert told == [(0, 2), (1, 2), (2, 2)]
    assert Kept(path, plan.key).missing(6) == [4, 5]
    assert not Kept(path, Plan(1).key).cases


def test_parts_of_several_processes_are_read_together_and_cut_lines_mended(tmp_path):
    path, key = tmp_path / "kept.jsonl", Plan(0).key
    for part in (0, 1):
        kept = Kept(path, key, part)
        kept.add(case(index=part))
        kept.add(case(index=part + 2))
    cut = tmp_path / "kept.jsonl.1"
    cut.write_text(cut.read_text()[:-30])
    assert sorted(Kept(path, key).cases) == [0, 1, 2]
    Kept(path, key, 1).add(case(index=3))
    assert sorted(Kept(path, key).cases) == [0, 1, 2, 3]
    assert [c["index"] for c in Kept(path, key).first(3)] == [0, 1, 2]


def test_the_digest_is_of_code_that_may_change_an_outcome(tmp_path):
    """Not of words about it, nor of code that only looks at what came out."""
    law, figure = tmp_path / "laws" / "hertz.py", tmp_path / "plots" / "bars.py"
    for file in (law, figure):
        file.parent.mkdir()
        file.write_text("POWER = 1.5\n")
    first = code_digest(tmp_path)
    law.write_text('"""Of a sphere."""\n\nPOWER = 1.5  # Hertz 1881\n')
    figure.write_text("POWER = 2.0\n")
    assert code_digest(tmp_path) == first
    law.write_text("POWER = 2.0\n")
    assert code_digest(tmp_path) != first
    law.rename(law.with_name("sphere.py"))
    figure.rename(tmp_path / "laws" / "hertz.py")
    assert code_digest(tmp_path) != first


# scores


def test_right_needs_all_that_is_hidden_and_nothing_else():
    assert is_right(case())
    assert is_right(nothing())
    assert not is_right(case(effects=("inertia",)))
    assert not is_right(case(effects=("viscous_drag", "inertia")))
    assert not is_right(case(verdict="adequate", effects=()))
    assert not is_right(case(verdict="ambiguous", group=("viscous_drag", "squeeze_film")))
    both = ("inertia", "friction")
    assert is_right(case(kind="double", names=both, effects=("friction", "inertia")))
    assert not is_right(case(kind="double", names=both, effects=("friction",)))
    assert not is_right(nothing("unexplained"))


def test_a_group_counts_if_it_is_small_and_holds_the_truth():
    def grouped(group, effects=("squeeze_film",), **more):
        return case(verdict="ambiguous", effects=effects, group=group, **more)

    assert is_right_or_grouped(grouped(("squeeze_film", "viscous_drag")))
    assert not is_right_or_grouped(grouped(("squeeze_film", "inertia")))
    assert not is_right_or_grouped(grouped(("squeeze_film", "inertia", "friction", "viscous_drag")))
    two = {"kind": "double", "names": ("inertia", "friction")}
    rivals = ("toe", "friction")
    assert is_right_or_grouped(grouped(rivals, effects=("inertia", "toe"), **two))
    assert not is_right_or_grouped(grouped(rivals, effects=("adhesion", "toe"), **two))
    assert not is_right_or_grouped(nothing("ambiguous", effects=("inertia",), group=("inertia",)))


def test_the_truth_is_left_open_if_it_is_one_of_few_explanations():
    def left(*explanations, **more):
        found = case(effects=("squeeze_film",), group=("squeeze_film",), **more)
        return is_left_open(found | {"not_ruled_out": [list(one) for one in explanations]})

    drag, film, inertia = ("viscous_drag",), ("squeeze_film",), ("inertia",)
    assert left(film, drag)
    assert left((), drag, verdict="adequate")
    assert not left(film, inertia)
    assert not left(film, ("viscous_drag", "inertia"))
    assert left(film, inertia, drag, ("friction",))
    assert not left(film, inertia, ("friction",), drag)
    assert not left(verdict="unexplained")
    assert is_left_open(case())


def test_a_form_is_found_by_any_effect_of_its_family():
    def form(**more):
        return case(kind="form", names=("growing_drag",), **more)

    assert names_family(form())
    assert names_family(form(effects=("squeeze_film", "inertia")))
    assert names_family(form(verdict="ambiguous", effects=("inertia",), group=("viscous_drag",)))
    assert not names_family(form(effects=("inertia",)))
    assert not names_family(form(verdict="unexplained", effects=()))


def test_rates_over_all_studies_and_over_those_that_could_be_seen():
    found = rates(
        [
            case(),
            case(effects=("inertia",)),
            case(verdict="adequate", effects=(), seen=False),
            nothing(),
            nothing("missing_effect", effects=("inertia",)),
            nothing("unexplained"),
            case(kind="outside", names=("slip",), effects=("inertia",)),
            case(kind="outside", names=("slip",), verdict="unexplained", effects=()),
        ]
    )
    assert found["single_right"] == {"all": Rate(1, 3), "seen": Rate(1, 2)}
    assert found["false_alarm"]["seen"] == Rate(1, 3)
    assert found["none_unexplained"]["seen"] == Rate(1, 3)
    assert found["outside_unexplained"]["all"] == Rate(1, 2)
    assert found["outside_confident"]["all"] == Rate(1, 2)
    assert found["abstention"]["all"] == Rate(2, 8)
    assert found["double_both"]["all"].share is None


def test_the_standard_error_is_binomial_and_never_zero():
    assert Rate(50, 100).error == pytest.approx(0.05)
    assert Rate(100, 100).error > 0.0
    assert str(Rate(0, 0)) == "-"


def test_the_confusion_matrix_counts_every_study_once():
    found = Confusion.of(
        [
            case(),
            case(effects=("inertia",)),
            case(effects=("inertia", "friction")),
            case(kind="double", names=("inertia", "friction"), verdict="ambiguous"),
            nothing(),
            case(kind="form", names=("toe",), effects=("contact_offset",)),
            case(kind="outside", names=("slip",), verdict="partly_explained"),
        ]
    )
    assert found.rows == ("none", "viscous_drag", "two effects", "toe", "slip")
    count = {
        (row, column): n
        for row, counts in zip(found.rows, found.counts, strict=True)
        for column, n in zip(found.columns, counts, strict=True)
        if n
    }
    assert count == {
        ("none", "none"): 1,
        ("viscous_drag", "viscous_drag"): 1,
        ("viscous_drag", "inertia"): 1,
        ("viscous_drag", "several"): 1,
        ("two effects", "ambiguous"): 1,
        ("toe", "contact_offset"): 1,
        ("slip", "partly_explained"): 1,
    }


def test_probabilities_that_keep_their_promise_have_no_calibration_error():
    good = [case(probability=0.75, effects=(e,)) for e in ("viscous_drag",) * 3 + ("inertia",)]
    assert Reliability.of(good).error == pytest.approx(0.0)
    bad = [nothing(probability=0.95) for _ in range(3)] + [
        case(probability=0.65, effects=("inertia",))
    ]
    found = Reliability.of(bad)
    assert found.error == pytest.approx((3 * 0.05 + 0.65) / 4)
    assert [(b.low, b.right) for b in found.bins] == [(0.6, Rate(0, 1)), (0.9, Rate(3, 3))]
    assert Reliability.of([case(kind="outside", names=("slip",))]).error is None


def test_chance_alone_makes_a_calibration_error():
    """The mean of |binomial / n - p|, nearly that of a normal."""
    found = Reliability.of([case(probability=0.75)] * 100)
    assert found.by_chance == pytest.approx(np.sqrt(2.0 / np.pi * 0.75 * 0.25 / 100), rel=0.1)
    assert Reliability.of([case(probability=1.0)]).by_chance == 0.0


def test_a_probability_of_one_falls_into_the_last_bin():
    (last,) = Reliability.of([case(probability=1.0)]).bins
    assert last.high == 1.0


def test_coverage_of_the_constants_before_and_after():
    found = constants([case(m=TRUE_M + 0.016), case(m=TRUE_M + 0.017), case(seen=False)])
    assert found["m"].before == Rate(0, 2)
    assert found["m"].after == Rate(1, 2)
    assert found["m"].off_before == pytest.approx(5.0)
    assert found["all"].after == Rate(1, 2)


def test_a_study_told_on_other_laws_says_nothing_of_a_constant_that_they_lack():
    other = case(m=TRUE_M) | {"found": {"m": [TRUE_M, 0.01]}}
    other["constants"] = {"m": TRUE_M, "c[0]": 0.3}
    other["stages"][0]["parameters"]["c[0]"] = [0.3, 0.01]
    found = constants([other])
    assert found["m"].after == found["all"].after == Rate(1, 1)
    assert "c[0]" not in found


def test_constants_of_rivals_are_scored_by_their_average():
    off = case(verdict="ambiguous", m=TRUE_M + 0.03)
    assert constants([off])["m"].after == Rate(0, 1)
    assert constants([off | {"found": {"m": [TRUE_M + 0.02, 0.02]}}])["m"].after == Rate(1, 1)


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


def test_modes_that_kept_their_names_keep_their_values():
    truth = {"c[0]": 0.5, "c[1]": 0.3, "c[2]": 0.2, "v[1]": 10.0, "v[2]": 0.4}
    fitted = {"v[1]": 9.0, "v[2]": 0.5, "extra_relaxation_mode.v": 1.5}
    assert named_as_fitted(truth, {"c": 0.1, "v": 2.0}, fitted) == pytest.approx(truth)


def test_the_ceiling_is_the_mean_chance_of_single_effects_that_could_be_seen():
    cases = [case() | {"chance": {"viscous_drag": p}} for p in (0.9, 1.0)]
    assert ceiling([*cases, nothing(), case(seen=False)]) == pytest.approx(0.95)
    assert ceiling([nothing()]) is None


def test_the_ranking_is_scored_whatever_the_verdict():
    missed = case(verdict="adequate", effects=(), first="none", probability=0.6)
    missed["probabilities"] = {"none": 0.6, "viscous_drag": 0.3, "inertia": 0.1}
    found = rates([case(), missed])
    assert found["single_first"]["seen"] == Rate(1, 2)
    assert found["single_high"]["seen"] == Rate(2, 2)
    assert promised([case(), missed]) == pytest.approx(0.75)


def test_left_out_tests_before_and_after():
    found = heldout([case(), case(), nothing(seen=True)])
    assert found["single"] == {"n": 2, "plain": pytest.approx(3.0), "final": pytest.approx(1.0)}
    assert found["double"]["plain"] is None


# what people see


@pytest.fixture
def report():
    cases = [
        case(index=0),
        nothing(index=1),
        case(kind="double", names=("inertia", "friction"), index=2),
        case(kind="form", names=("toe",), effects=("contact_offset",), index=3),
        case(kind="outside", names=("slip",), verdict="unexplained", effects=(), index=4),
        case(effects=("inertia",), index=5),
    ]
    return Report.of(Plan(0), cases)


def test_the_report_is_json(report):
    found = json.loads(json.dumps(report.as_dict(), allow_nan=False))
    assert found["studies"] == 6
    assert found["rates"]["single_right"]["seen"]["share"] == 0.5
    assert len(found["cases"]) == 6


def test_tables_and_figure_can_be_made(report, tmp_path):
    assert rates_table(report).row_count > 5
    assert constants_table(report).row_count == 2
    figure = figure_of(plot_benchmark(report))
    upper = figure.axes[0]
    assert [label.get_text() for label in upper.get_yticklabels()] == [
        "none",
        "viscous drag",
        "two effects",
        "toe (form of contact offset)",
        "slip (outside)",
    ]
    empty = Report.of(Plan(0), [])
    json.dumps(empty.as_dict(), allow_nan=False)
    figure_of(plot_benchmark(empty)).savefig(tmp_path / "empty.png")


def test_the_page_says_what_is_met_and_what_is_not(report):
    origin = Origin("command", "2026-01-01", "abc1234", "2 cores")
    text = blind_page(report, origin, "pictures/blind_studies.png")
    assert "one effect: named | at least 95 % | 50.0 %" in text
    assert "**not met**" in text
    assert "| 5 | viscous_drag | missing_effect | inertia | nothing |" in text
    words = {row.words: row for row in levels(report)}
    assert words["outside the list: unexplained"].met
    assert not words["two effects: both named"].met


def test_levels_know_their_bounds():
    assert Level("", 0.9, 0.01, 10, 0.85, 0.95).met
    assert not Level("", 0.96, 0.01, 10, 0.85, 0.95).met
    assert Level("", 0.96, 0.01, 10, 0.85, 0.95).in_doubt
    assert not Level("", None, None, 0, 0.85, None).met
    assert Level("", 0.9, 0.01, 10, 0.85, 0.95).asked == "85 % to 95 %"


@pytest.fixture
def command():
    import typer

    app = typer.Typer()
    app.command()(benchmark)
    return lambda *words: CliRunner().invoke(app, list(words))


@pytest.mark.slow
def test_the_command_writes_json_and_figure(command, tmp_path, monkeypatch):
    monkeypatch.setattr(one_study, "run_case", lambda plan, index: case(index=index))
    found = command("--studies", "3", "-o", str(tmp_path), "--json")
    assert found.exit_code == 0, found.output
    written = json.loads((tmp_path / "benchmark.json").read_text())
    assert written == json.loads(found.stdout)
    assert written["studies"] == 3
    assert (tmp_path / "benchmark.png").exists()
    assert (tmp_path / "benchmark.pdf").exists()
    again = command("--studies", "3", "-o", str(tmp_path))
    assert again.exit_code == 0
