"""Check comparisons of two pads: known differences, equals, and what stays open."""

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.stats import kstest, norm
from support.endtoend import fitted
from support.posteriors import ORDER, PLACES, WIDTHS, posterior, table_1

from qlvbayes.comparison.compare import answer, compare, contrast
from qlvbayes.comparison.contrast import as_csv, as_latex
from qlvbayes.comparison.readings import Reading
from qlvbayes.comparison.statistics import FALSE_ALARMS, joint_test
from qlvbayes.comparison.words import paragraphs
from qlvbayes.io.checks import InputError

FEW = 100  # draws, where what is compared is looked at and not how it comes out
UNIT = Reading("m", "N/mm", "constants", False)


@pytest.fixture(scope="module")
def oil_and_glycerin():
    rng = np.random.default_rng(0)
    first, second = (posterior(table_1(pad), rng, centred=True) for pad in "BC")
    return compare(first, second, names=("B", "C"), **PLACES)


def test_known_differences_are_found_and_same_rates_told_equal_or_left_open(oil_and_glycerin):
    found = oil_and_glycerin
    assert found.differ is True
    assert found.omnibus.p_value < 1e-6
    answers = {name: found[name].answer for name in ("m", "b", "c[0]", "c[2]")}
    assert answers == {"m": "less", "b": "greater", "c[0]": "less", "c[2]": "greater"}
    true, other = table_1("B"), table_1("C")
    for name in ("m", "b", "c[2]"):
        ratio = found[name].ratio
        # four standard errors of a median of 300 pairs
        error = 4.0 * 1.25 * np.sqrt(2.0 / 300) * WIDTHS[name]
        assert abs(np.log(ratio.median / (true[name] / other[name]))) < error
        assert found[name].difference.median == pytest.approx(
            found[name].first.median - found[name].second.median, abs=0.02
        )
    # the paper's open question: its v1 and v2 are the same for oil and for glycerin
    assert found["v[1]"].answer == "equal"
    assert found["v[2]"].answer == "cannot tell"
    groups = ["constants", "stiffness", "force", "relaxation", "energy", "loss tangent"]
    assert list(dict.fromkeys(c.group for c in found.contrasts)) == groups


def test_turning_the_pair_round_turns_answers_and_against_itself_it_is_equal_or_open():
    rng = np.random.default_rng(1)
    first, second = (posterior(table_1(pad), rng, size=150, centred=True) for pad in "AC")
    there = compare(first, second, names=("A", "C"), **PLACES)
    back = compare(second, first, names=("C", "A"), **PLACES)
    turned = {"greater": "less", "less": "greater", "equal": "equal", "cannot tell": "cannot tell"}
    for one, other in zip(there.contrasts, back.contrasts, strict=True):
        assert one.direction == pytest.approx(1.0 - other.direction, abs=0.03)
        assert one.difference.median == pytest.approx(-other.difference.median, rel=0.1, abs=0.01)
        if one.quantity in ("m", "b", "c[2]", "v[1]"):
            assert turned[one.answer] == other.answer
    draws = posterior(table_1("B"), np.random.default_rng(2), size=100)
    found = compare(draws, draws, names=("B", "B again"), **PLACES)
    assert not {c.answer for c in found.contrasts} & {"greater", "less"}
    assert found.differ is None  # v[2] is too wide to be called equal
    sharp = {name: 0.1 * width for name, width in WIDTHS.items()}
    draws = posterior(table_1("B"), np.random.default_rng(2), sharp, size=100)
    found = compare(draws, draws, **PLACES)
    assert {c.answer for c in found.contrasts} == {"equal"}
    assert found.differ is False
    assert paragraphs(found)[0].startswith("No: ")


def test_probabilities_are_those_of_normal_draws_and_a_change_of_sign_has_no_ratio():
    """Direction and equivalence against the normal distribution, to a draw's own error."""
    rng = np.random.default_rng(3)
    first, second = rng.normal(10.2, 0.3, 400_000), rng.normal(10.0, 0.4, 400_000)
    found = contrast(UNIT, first, second, 0.1)
    assert found.direction == pytest.approx(norm.cdf(0.2 / 0.5), abs=4e-3)
    # x/y <= r where x - r y <= 0, also normal
    below = lambda r: norm.cdf(-(10.2 - r * 10.0) / np.hypot(0.3, r * 0.4))  # noqa: E731
    assert found.equivalence == pytest.approx(below(1.1) - below(1 / 1.1), abs=4e-3)
    tail = norm.ppf(0.95) * 0.5
    assert found.difference.high == pytest.approx(0.2 + tail, abs=0.01)
    assert found.difference.low == pytest.approx(0.2 - tail, abs=0.01)
    rng = np.random.default_rng(4)
    found = contrast(UNIT, rng.normal(0.0, 1.0, 1000), rng.normal(5.0, 1.0, 1000), 0.1)
    assert found.ratio is None
    assert found.answer == "less"
    same = contrast(UNIT, np.zeros(100), np.zeros(100), 0.1)
    assert (same.direction, same.equivalence, same.answer) == (0.5, 1.0, "equal")


@pytest.mark.parametrize(
    ("direction", "equivalence", "wanted"),
    [
        (0.99, 0.10, "greater"),
        (0.01, 0.10, "less"),
        (0.90, 0.60, "cannot tell"),
        (0.60, 0.96, "equal"),
        (0.99, 0.96, "equal"),  # real, but within the region
    ],
)
def test_equal_is_not_the_same_as_not_shown_to_differ(direction, equivalence, wanted):
    assert answer(direction, equivalence) == wanted


def test_the_joint_test_is_a_chi_square_that_equals_fail_in_one_per_cent():
    """Its p-values are uniform over pairs of equal pads, each with an error of its own."""
    rng = np.random.default_rng(5)
    truth = table_1("B")
    p_values = []
    for _ in range(400):
        first, second = (posterior(truth, rng, size=400) for _ in range(2))
        p_values.append(joint_test(first, second).p_value)
    alarms = np.mean(np.array(p_values) < FALSE_ALARMS)
    assert alarms < FALSE_ALARMS + 3.0 * np.sqrt(FALSE_ALARMS / 400)
    assert kstest(p_values, "uniform").pvalue > 1e-3
    # one constant, in the logarithm
    rng = np.random.default_rng(6)
    first, second = np.exp(rng.normal(0.0, 0.1, 500)), np.exp(rng.normal(0.3, 0.2, 500))
    found = joint_test({"m": first}, {"m": second})
    gap = np.log(first).mean() - np.log(second).mean()
    spread = np.log(first).var(ddof=1) + np.log(second).var(ddof=1)
    assert found.freedom == 1
    assert found.statistic == pytest.approx(gap**2 / spread)
    assert found.p_value == pytest.approx(2 * norm.sf(abs(gap) / np.sqrt(spread)))


def test_what_both_do_not_share_is_left_out_and_told():
    rng = np.random.default_rng(7)
    pad, other = (posterior(table_1(name), rng, size=FEW) for name in "BC")
    drag = other | {"viscous_drag.eta": np.full(FEW, 0.003)}
    found = compare(pad, drag, names=("B", "C"), **PLACES)
    assert "viscous_drag.eta" not in [c.quantity for c in found.contrasts]
    assert {c.quantity for c in found.of_group("constants")} == set(ORDER)
    assert any("only C was fitted with viscous_drag" in notice for notice in found.notices)
    mode = {"c[0]": np.full(FEW, 0.4), "c[1]": np.full(FEW, 0.6), "v[1]": np.full(FEW, 5.0)}
    one = {"m": 0.3 * np.exp(0.01 * rng.standard_normal(FEW)), "b": np.ones(FEW)} | mode
    found = compare(one, pad, **PLACES)
    assert [c.quantity for c in found.of_group("constants")] == ["m", "b"]
    assert any("different numbers of relaxation modes" in notice for notice in found.notices)
    found = compare({"m": one["m"], "n": np.full(FEW, 1.5)} | mode, pad, **PLACES)
    assert (found.differ, found.omnibus, len(found.contrasts)) == (None, None, 9)
    assert "no constant is shared" in " ".join(found.notices)
    assert paragraphs(found)[0].startswith("Cannot tell")
    first, second = (x | {"v[2]": np.full(FEW, 0.14)} for x in (pad, other))
    found = compare(first, second, **PLACES)
    assert "v[2]" not in [c.quantity for c in found.contrasts]
    assert "fixed, not fitted, and not compared: v[2]" in found.notices
    assert found.omnibus.freedom == 5


def test_shares_of_models_with_different_effects_on_relaxation_are_those_of_the_whole_model():
    """A mode of share c leaves the others (1 - c) of the force; their c[0] is of another law."""
    rng = np.random.default_rng(11)
    first, second = (posterior(table_1("B"), rng, size=FEW) for _ in range(2))
    mode = {"c": np.full(FEW, 0.25), "v": np.full(FEW, 0.02)}
    second |= {f"extra_relaxation_mode.{name}": values for name, values in mode.items()}
    found = compare(first, second, names=("B", "C"), **PLACES)
    assert [c.quantity for c in found.of_group("constants")] == ["m", "b"]
    assert "different effects on the relaxation: c and v are not compared" in found.notices
    share = found["share that never relaxes"]
    assert share.first.median == pytest.approx(np.median(first["c[0]"]), rel=1e-3)
    assert share.second.median == pytest.approx(0.75 * np.median(second["c[0]"]), rel=1e-3)
    alike = compare(second, second, names=("B", "C"), **PLACES)
    assert "c[0]" in [c.quantity for c in alike.of_group("constants")]
    assert "share that never relaxes" not in [c.quantity for c in alike.contrasts]


@pytest.mark.slow
def test_fits_are_compared_at_places_that_their_tests_reach():
    """A fit against itself, nothing said of depth, rates and frequencies."""
    fit = fitted(method="least-squares")
    found = compare(fit, fit, seed=3)
    assert found.settings.depth == 1.5
    assert found.settings.rates == (0.1, 3.0, 30.0)
    assert not any(c.extrapolated for c in found.contrasts)
    assert found.differ in (None, False)
    assert any("fitted to B-20 of 6 tests" in notice for notice in found.notices)
    assert found.as_dict() == compare(fit, fit, seed=3).as_dict()


def test_tables_hold_every_number_and_names_as_they_are(oil_and_glycerin):
    rows = [line.split(",") for line in as_csv(oil_and_glycerin).splitlines()[1:]]
    assert len(rows) == 1 + len(oil_and_glycerin.contrasts)
    named = dict(zip(rows[0], rows[1], strict=True))
    assert float(named["ratio_median"]) == pytest.approx(
        oil_and_glycerin["m"].ratio.median, rel=1e-5
    )
    latex = as_latex(oil_and_glycerin)
    body = latex.split("\\midrule\n")[1].split("\n\\bottomrule")[0].splitlines()
    assert len(body) == len(oil_and_glycerin.contrasts)
    assert all(line.count(" & ") == 7 for line in body)
    odd = replace(oil_and_glycerin, names=("50%_oil", "a&b\\c"))
    latex = as_latex(odd)
    assert "50\\%\\_oil" in latex
    assert "a\\&b\\textbackslash{}c" in latex


@pytest.mark.parametrize(
    ("words", "lost", "problem"),
    [
        ({"region": 0.0}, "", "region"),
        ({"depth": -1.0}, "", "depth"),
        ({"rates": [1.0, 0.0]}, "", "rate"),
        ({"frequencies": [float("nan")]}, "", "frequency"),
        ({}, "v[2]", r"lacks v\[2\]"),
    ],
)
def test_numbers_that_make_no_sense_and_draws_that_lack_a_constant_are_refused(
    words, lost, problem
):
    draws = posterior(table_1("B"), np.random.default_rng(0), size=200)
    draws.pop(lost, None)
    with pytest.raises(InputError, match=problem):
        compare(draws, draws, **words)
