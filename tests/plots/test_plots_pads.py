"""Check figures of pads next to each other, and of one pad's posterior and programme."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.collections import FillBetweenPolyCollection
from support.figures import prediction, protocol
from support.pages import collisions, keeps_the_page, lines, points, texts

from qlvbayes.comparison.contrast import Comparison, Contrast, Interval
from qlvbayes.fitting.results import Saved
from qlvbayes.fitting.summary import Constant, Entry, FitSummary, Reference, constants_table
from qlvbayes.io.units import PAD, STRAIN
from qlvbayes.model.choices import Choices
from qlvbayes.plots import (
    figure_of,
    plot_constants,
    plot_contrasts,
    plot_forces_at_rates,
    plot_hysteresis,
    plot_pairs,
    plot_programme,
)

WIDTHS = (85.0, 180.0)
RATES = (0.1, 1.0, 10.0, 20.0, 29.3, 32.7)


def pressed(pad="B", rates=RATES, moves=(1.6, -0.8)):
    return [prediction(f"{pad}-{r:g}", protocol(moves, r, 30.0), r) for r in rates]


def moved(trial):
    """The trial with the displacement that its phases tell."""
    places = {0.0: 0.0}
    depth = 0.0
    for phase in trial.phases:
        depth += {"ramp": 1.6, "unload": -0.8}.get(phase.kind, 0.0)
        places[phase.stop] = depth
    time = np.array(list(places))
    fine = np.unique(np.concatenate([time, np.linspace(0.0, time[-1], 400)]))
    displacement = np.interp(fine, time, list(places.values()))
    test = replace(trial.test, time=fine, displacement=displacement)
    path = SimpleNamespace(displacement=lambda t: np.interp(t, time, list(places.values())))
    return replace(trial, test=test, trajectory=path)


@cache
def experiment(rates=RATES, units=PAD):
    trials = tuple(moved(p.trial) for p in pressed(rates=rates))
    return SimpleNamespace(pad="B", trials=trials, units=units)


def looped(rates=RATES):
    """Predictions of tests whose displacement is known."""
    return [replace(p, trial=moved(p.trial)) for p in pressed(rates=rates)]


def table(pads="ABC"):
    """Constants of some pads with m = 1, 2, ... and intervals of a tenth."""
    known = {"m": "N/mm", "b": "1/mm", "c[0]": "1", "v[1]": "1/s", "viscous_drag.eta": "N s/mm"}
    summaries = [
        FitSummary(
            pad=pad,
            effects=(),
            sampler="emcee",
            converged=True,
            parameters={
                name: Constant(unit, k + 1.0, 0.06, k + 1.0, (k + 0.9, k + 1.1), None, None)
                for name, unit in {**known, "noise.white": "N"}.items()
            },
        )
        for k, pad in enumerate(pads)
    ]
    return constants_table(summaries, {("A", "m"): Reference(1.05, "N/mm")})


def posterior(modes=2, law="exponential", effect=""):
    """Draws in which m and b are correlated by -0.9 and the shares c sum to 1."""
    rng = np.random.default_rng(1)
    m, other = rng.standard_normal((2, 4000))
    names = {"m": 0.34 + 0.004 * m, "b": 1.17 + 0.01 * (-0.9 * m + np.sqrt(0.19) * other)}
    if law == "linear":
        del names["b"]
    shares = rng.dirichlet(400.0 * np.arange(1.0, modes + 2.0), 4000)
    names |= {f"c[{k}]": shares[:, k] for k in range(modes + 1)}
    names |= {f"v[{k}]": 6.0 / k + 0.1 * rng.standard_normal(4000) for k in range(1, modes + 1)}
    added = ()
    if effect:
        added = effect.split(".")[0]
        names[effect] = 0.00171 + 1e-4 * rng.standard_normal(4000)
    names |= {"noise.white": np.full(4000, 0.01)}
    return Saved(
        "B", tuple(names), np.stack(list(names.values()), axis=-1)[None],
        Choices(modes=modes, elastic=law, noise="white", effects=added),
        "emcee", "", "", False, (),
    )  # fmt: skip


def contrast(name, ratio, answer, group="constants", unit="1", extrapolated=False):
    found = None if ratio is None else Interval(ratio, 0.95 * ratio, 1.05 * ratio)
    value = Interval(1.0, 0.9, 1.1)
    return Contrast(
        name, value, value, unit, Interval(0.0, -0.1, 0.1), found, 0.609, 0.2, answer, group,
        extrapolated,
    )  # fmt: skip


def comparison(*more, region=0.1):
    found = (
        contrast("m", 0.34, "less"), contrast("b", 2.3, "greater"), contrast("c[1]", 1.0, "equal"),
        contrast("v[2]", 0.95, "cannot tell"),
        contrast("loss tangent at 0.3 Hz about 1 mm", 1.02, "equal", "loss tangent"),
        contrast("energy lost in a cycle at 30 mm/s", 0.5, "less", "energy", extrapolated=True),
        contrast("relaxed force at 1 mm", None, "cannot tell", "force"),
    )  # fmt: skip
    return Comparison(
        names=("B", "C"), between="pads", region=region, contrasts=(*found, *more), differ=True
    )


# a stiffness in N/um, and tight intervals
MANY_DIGITS = [
    ("m", "N/um", 8.259e-4, 8.236e-4, 8.28e-4),
    ("c[0]", "1", 0.54545, 0.54476, 0.54609),
    ("c[1]", "1", 0.28442, 0.28353, 0.28534),
    ("c[2]", "1", 0.17013, 0.16939, 0.17083),
    ("v[2]", "1/s", 1.2025, 1.1939, 1.2106),
]  # fmt: skip


DRAWN = {
    "programme": lambda width: plot_programme(experiment(), width=width),
    "rates": lambda width: plot_forces_at_rates(
        {pad: pressed(pad) for pad in "BC"}, PAD, width=width
    ),
    "three pads": lambda width: plot_forces_at_rates(
        {pad: pressed(pad) for pad in "ABC"}, PAD, width=width
    ),
    "constants": lambda width: plot_constants(table(), reference="Table 1", width=width),
    "constants of many digits": lambda width: plot_constants(
        [Entry("B", *one) for one in MANY_DIGITS], width=width
    ),
    "pairs": lambda width: plot_pairs(posterior(), width=width),
    "pairs of three modes": lambda width: plot_pairs(posterior(3), width=width),
    "pairs of a linear law": lambda width: plot_pairs(posterior(1, "linear"), width=width),
    "pairs with a long name": lambda width: plot_pairs(
        posterior(effect="strain_dependent_strength.beta"), width=width
    ),
    "a loop": lambda width: plot_hysteresis(looped(RATES[:1]), PAD, width=width),
    "loops": lambda width: plot_hysteresis(looped(), PAD, width=width),
    "contrasts": lambda width: plot_contrasts(comparison(), width=width),
}


@cache
def page(name, width):
    return figure_of(DRAWN[name](width))


every_page = pytest.mark.parametrize("width", WIDTHS)
every_figure = pytest.mark.parametrize("name", DRAWN)


@every_page
@every_figure
@pytest.mark.few(3)
def test_nothing_leaves_the_page_and_no_text_runs_into_another(name, width):
    figure = page(name, width)
    assert keeps_the_page(figure, width)
    assert collisions(figure) == []
    assert min(t.get_fontsize() for t in texts(figure)) >= 6.0


def labels(figure):
    names = [x.get_xlabel() for x in figure.axes] + [x.get_ylabel() for x in figure.axes]
    return {" ".join(name.split()) for name in names if name}


def test_every_axis_names_its_unit():
    time = "time since the first movement (s)"
    assert labels(page("programme", 85.0)) == {time, "displacement (mm)"}
    assert labels(page("rates", 85.0)) == {time, "force (N)"}
    assert labels(page("contrasts", 85.0)) == {"ratio B / C (no unit)"}
    constants = labels(page("constants", 85.0))
    assert {"$\\mathit{m}$ (N/mm)", "viscous_drag eta (N s/mm)", "$\\mathit{c}_{0}$"} <= constants
    pairs = labels(page("pairs", 180.0))
    assert {"$\\mathit{b}$ (1/mm)", "$\\mathit{v}_{2}$ (1/s)", "density"} <= pairs
    strained = figure_of(plot_programme(experiment(units=STRAIN)))
    assert labels(strained) == {time, "strain"}


def test_the_programme_holds_every_test_and_marks_its_phases():
    axes = plot_programme(experiment())
    assert [axis.get_xscale() for axis in axes] == ["log", "linear"]
    for trial in experiment().trials:
        for axis in axes:
            (curve,) = (line.get_xydata() for line in lines(axis, trial.name))
            shown = np.interp(curve[:, 0], trial.test.time, trial.test.displacement)
            assert curve[:, 1] == pytest.approx(shown)
            assert curve[-1, 0] == trial.test.time[-1]
    for kind, depth in (("ramp", 0.0), ("hold", 1.6), ("unload", 1.6), ("recovery", 0.8)):
        places = points(axes[1], kind)
        starts = [p.start for t in experiment().trials for p in t.phases if p.kind == kind]
        assert places[:, 0] == pytest.approx(starts)
        assert places[:, 1] == pytest.approx(depth, abs=0.02)


def test_the_nearest_test_to_each_rate_is_drawn_with_its_band():
    predictions = {"B": pressed("B"), "C": pressed("C", RATES[:4])}
    axes = plot_forces_at_rates(predictions, PAD)
    assert len(axes) == 4
    for pad, fastest, axis in zip("BC", (29.3, 20.0), axes[1::2], strict=True):
        assert axes[0].get_title(loc="left") == "pad B"
        found = {p.trial.rate: p for p in predictions[pad]}
        chosen = [found[rate] for rate in (0.1, 1.0, fastest)]
        seen = points(axis, "measured")
        assert seen[:, 1] == pytest.approx(np.concatenate([p.observed for p in chosen]))
        assert seen[:, 0] == pytest.approx(np.concatenate([p.time for p in chosen]))
        bands = [c for c in axis.collections if isinstance(c, FillBetweenPolyCollection)]
        for band, p in zip(bands, chosen, strict=True):
            heights = band.get_paths()[0].vertices[:, 1]
            assert heights.max() == pytest.approx(p.high.max())
            assert heights.min() == pytest.approx(p.low.min())
    entries = [t.get_text() for t in figure_of(axes).legends[0].get_texts()]
    assert entries == ["0.1 mm/s", "1 mm/s", "20 mm/s to 29.3 mm/s", "90 % predictive band"]


def test_constants_stand_at_their_values_and_the_noise_is_left_out():
    axes = plot_constants(table(), reference="Table 1")
    assert len(axes) == 5
    first = axes[0]
    assert points(first, "median")[:, 0] == pytest.approx([1.0, 2.0, 3.0])
    ends = points(first, "interval")[:, 0]
    assert ends == pytest.approx([0.9, 1.1, 1.9, 2.1, 2.9, 3.1])
    assert points(first, "reference")[:, 0] == pytest.approx([1.05])
    assert not lines(axes[1], "reference")
    assert first.texts[0].get_text() == "1.00 (0.90 to 1.10)"
    rows = [t.get_text() for t in first.get_yticklabels()]
    assert rows == ["pad A", "pad B", "pad C"]
    assert "Table 1" in [t.get_text() for t in texts(figure_of(axes))]


def test_pairs_hold_the_draws():
    found = posterior()
    axes = plot_pairs(found)
    draws = dict(zip(found.names, found.draws.T, strict=True))
    assert len(axes) == 7 * 8 // 2
    middle = lines(axes[0], "median")[0].get_xdata()[0]
    assert middle == pytest.approx(np.median(draws["m"]))
    outer, inner = (
        np.concatenate([path.vertices for path in region.get_paths()])
        for region in axes[1].collections
    )
    for region, quantile in ((outer, 2.146), (inner, 1.177)):  # sqrt(chi2 of 2, 0.90 and 0.50)
        for column, name in enumerate(("m", "b")):
            half = 0.5 * np.ptp(region[:, column])
            # blurred by 1.6 bins of a range of 8 sds in 36
            assert half == pytest.approx(
                quantile * np.hypot(1.0, 0.35) * draws[name].std(), rel=0.1
            )
    assert np.corrcoef(*outer.T)[0, 1] < -0.6


def test_contrasts_hold_ratios_answers_and_the_region():
    axis = plot_contrasts(comparison(region=0.2))
    assert points(axis, "median")[:, 0] == pytest.approx([0.34, 2.3, 1.0, 0.95, 1.02, 0.5])
    ends = points(axis, "interval")[:, 0].reshape(-1, 2)
    assert ends[0] == pytest.approx([0.95 * 0.34, 1.05 * 0.34])
    (shade,) = (p for p in axis.patches if p.get_gid() == "equal")
    assert shade.get_x() == pytest.approx(1 / 1.2)
    assert shade.get_x() + shade.get_width() == pytest.approx(1.2)
    words = [t.get_text() for t in axis.texts]
    answers = ("less", "greater", "equal", "cannot tell")
    assert [w for w in words if w in answers] == [c.answer for c in comparison().contrasts]
    assert words.count("60.9 %") == 7
    assert words.count("no ratio") == 1
    rows = [t.get_text() for t in axis.get_yticklabels()]
    assert rows[0] == "constants"
    assert rows[5:7] == ["loss tangent", "loss tangent at 0.3 Hz about 1 mm"]
    assert "energy lost in a cycle at 30 mm/s *" in rows
    assert "beyond what the tests" in figure_of(axis).get_supxlabel()


def test_loops_show_every_sample_at_its_displacement():
    found = looped((1.0,))
    (axis,) = plot_hysteresis(found, PAD)
    test = found[0].trial.test
    place = np.interp(found[0].time, test.time, test.displacement)
    np.testing.assert_array_equal(points(axis, "measured")[:, 0], place)
    np.testing.assert_array_equal(points(axis, "measured")[:, 1], found[0].observed)
    back = [line for line in lines(axis, "mean") if line.get_linestyle() == "--"]
    assert len(back) == 2  # unloading and the rest after it
    assert back[0].get_xdata()[0] > back[0].get_xdata()[-1]
