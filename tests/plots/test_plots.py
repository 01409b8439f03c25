"""Figures of fits, checks and comparisons: what stands where, on a page of any width; files."""

import sys
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import matplotlib
import msgspec
import numpy as np
import pytest
from matplotlib._pylab_helpers import Gcf
from matplotlib.collections import FillBetweenPolyCollection
from support.figures import NOISE, page, prediction, protocol
from support.pages import collisions, drawn, keeps_the_page, lines, points, texts

from qlvbayes import plots
from qlvbayes.comparison.contrast import Comparison, Contrast, Interval
from qlvbayes.fitting.residuals import Cell, CheckResult, check
from qlvbayes.fitting.results import Saved
from qlvbayes.fitting.summary import Constant, Entry, FitSummary, Reference, constants_table
from qlvbayes.io.units import PAD, STRAIN
from qlvbayes.model.choices import Choices
from qlvbayes.motion.phases import MOVING, Phase
from qlvbayes.plots import (
    figure_of,
    plot_constants,
    plot_contrasts,
    plot_forces,
    plot_forces_at_rates,
    plot_hysteresis,
    plot_pairs,
    plot_programme,
    plot_residual_map,
    save_figure,
)
from qlvbayes.plots.panels import PhaseTime

WIDTHS = (85.0, 180.0)
RATES = (0.1, 1.0, 10.0, 20.0, 29.3, 32.7)


def one(name, moves, speed, rest, rate=None, **options):
    rate = speed if rate is None else rate
    return prediction(name, protocol(moves, speed, rest), rate, **options)


def pressed(pad="B", rates=RATES, moves=(1.6, -0.8)):
    """Press by 1.6 mm, hold, back by 0.8 mm, hold."""
    return [one(f"{pad}-{r:g}", moves, r, 30.0) for r in rates]


PROTOCOLS = {
    "paper": [replace(p, trial=replace(p.trial, role="validate" if k else "fit"))
              for k, p in enumerate(pressed(rates=(20.0, 0.1, 1.0)))],
    "one test": pressed(rates=(0.1,)),
    "staircase": [one("stairs", (1,) * 5, 0.05, 180.0, force=lambda t: t)],
    "more cycles than fit": [one("cycles", (1, -1) * 9, 0.5, 18.0, role="fit", force=lambda t: t)],
    "a rest first": [
        prediction("w", (Phase("hold", 0.0, 0.5), *protocol([1.6], 20.0, 30.0, 0.5)), 20.0)
    ],
    "rest of less than a decade": [
        prediction("few", (Phase("ramp", 0.0, 1.0), Phase("hold", 1.0, 9.0)), np.nan,
                   time=np.array([0.0, 0.5, 3.0, 5.0, 7.0, 9.0]))
    ],
    "no sample in the ramp": [one("coarse", [1.0], 100.0, 30.0, time=np.arange(1.0, 30.0))],
    "huge forces": [one("huge", [1.0], 1.0, 9.0, force=lambda t: 1e6 * t)],
    "long name": [one("mavacamten-" * 12, [1.0], 1.0, 9.0)],
}  # fmt: skip

every_width = pytest.mark.parametrize("width", WIDTHS)
every_protocol = pytest.mark.parametrize("predictions", PROTOCOLS.values(), ids=PROTOCOLS)


@pytest.mark.parametrize("wide", [60.0, 160.0])
@every_protocol
def test_time_is_linear_in_movements_logarithmic_in_rests_and_never_turns_back(predictions, wide):
    for shown in predictions:
        time, phases = PhaseTime.of(shown.trial, wide), shown.trial.phases
        whole = np.linspace(phases[0].start, phases[-1].stop, 4001)
        assert np.all(np.diff(time(whole)) >= 0.0)
        if not time.side_by_side:
            assert 6.0 * len(phases) > wide
            assert np.array_equal(time(whole), whole)
            continue
        for k, phase in enumerate(phases):
            shares = np.array([0.25, 0.5, 1.0 - 1e-9])
            across = time(phase.start + shares * (phase.stop - phase.start)) - time.edges[k]
            quarter, half, end = across / (time.edges[k + 1] - time.edges[k])
            assert end == pytest.approx(1.0, abs=1e-6)
            if phase.kind in MOVING:
                assert (quarter, half) == pytest.approx((0.25, 0.5))
            else:
                assert half > quarter > 0.5


@every_protocol
def test_every_sample_and_band_is_in_view(predictions):
    axes = plot_forces(predictions, PAD)
    assert sum(len(points(axis, "measured")) for axis in axes) == sum(
        p.time.size for p in predictions
    )
    for axis in axes:
        band = axis.collections[0].get_paths()[0].vertices
        for seen in (points(axis, "measured"), band):
            (left, right), (bottom, top) = axis.get_xlim(), axis.get_ylim()
            assert np.all((seen[:, 0] >= left) & (seen[:, 0] <= right))
            assert np.all((seen[:, 1] >= bottom) & (seen[:, 1] <= top))


@every_width
@every_protocol
@pytest.mark.few(4)
def test_no_text_leaves_the_page_and_numbers_do_not_touch(predictions, width):
    figure = page(plot_forces, predictions, PAD, width=width)
    assert keeps_the_page(figure, width)
    renderer = drawn(figure)
    for axis in figure.axes:
        left, right = axis.get_xlim()
        ticks = [t for t in axis.xaxis.get_major_ticks() if left <= t.get_loc() <= right]
        boxes = [t.label1.get_window_extent(renderer) for t in ticks if t.label1.get_text()]
        assert len(boxes) >= 2
        assert all(a.x1 < b.x0 for a, b in pairwise(boxes))


def test_failing_cells_and_only_they_are_framed():
    def cell(test, rate, phase, over=1.0, p=0.5):
        return Cell(test, "validate", rate, phase, 9, over * NOISE, 0.0, 0.9, p, fails=p < 0.01)

    cells = (
        cell("slow", 0.1, "ramp"), cell("slow", 0.1, "hold", 5.0, 1e-9),
        cell("quick", 9.0, "unload", 5.0), cell("quick", 9.0, "recovery", 1.0, 1e-4),
    )  # fmt: skip
    axis = plot_residual_map(CheckResult(pad="B", noise=NOISE, cells=cells), PAD)
    squares = {(round(p.get_y()), round(p.get_x())): p for p in axis.patches}
    framed = {place for place, p in squares.items() if p.get_gid() == "fails"}
    assert framed == {(0, 1), (1, 3)}
    assert all(squares[place].get_linewidth() > 1.0 for place in framed)
    assert [t.get_text() for t in axis.texts].count("×") == 2


@every_protocol
@pytest.mark.few(1)
def test_the_map_of_any_protocol_stays_on_the_page(predictions):
    found = check("B", NOISE, predictions)
    for noise, width in ((NOISE, 120.0), (0.0, 85.0), (1e-7, 120.0)):
        changed = msgspec.structs.replace(found, noise=noise)
        assert keeps_the_page(page(plot_residual_map, changed, PAD, width=width), width)


def test_files_are_whole_repeatable_and_hold_their_fonts(tmp_path):
    shown, document = PROTOCOLS["staircase"], tmp_path / "pad.1.pdf"
    image = save_figure(page(plot_forces, shown, PAD), tmp_path / "pad.1")
    assert sorted(tmp_path.iterdir()) == [document, image]
    first = image.read_bytes(), document.read_bytes()
    assert (first[0][:8], first[0][-8:]) == (b"\x89PNG\r\n\x1a\n", b"IEND\xaeB`\x82")
    assert (first[1][:5], first[1][-6:]) == (b"%PDF-", b"%%EOF\n")
    assert b"/FontFile2" in first[1]
    assert b"/Type3" not in first[1]
    save_figure(page(plot_forces, shown, PAD), tmp_path / "pad.1")
    assert (image.read_bytes(), document.read_bytes()) == first


def test_a_user_s_settings_and_windows_are_left_alone(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)  # importing it would now fail
    before = dict(matplotlib.rcParams.copy())
    save_figure(page(plot_residual_map, check("B", NOISE, PROTOCOLS["paper"]), PAD), tmp_path / "m")
    assert dict(matplotlib.rcParams.copy()) == before
    assert Gcf.get_num_fig_managers() == 0
    sources = Path(plots.__file__).parent.glob("*.py")
    assert not any("pyplot" in source.read_text(encoding="utf-8") for source in sources)


def moved(trial):
    """The trial with the displacement that its phases tell."""
    places, depth = {0.0: 0.0}, 0.0
    for phase in trial.phases:
        depth += {"ramp": 1.6, "unload": -0.8}.get(phase.kind, 0.0)
        places[phase.stop] = depth
    time = np.array(list(places))
    fine = np.unique(np.concatenate([time, np.linspace(0.0, time[-1], 400)]))

    def at(t):
        return np.interp(t, time, list(places.values()))

    test = replace(trial.test, time=fine, displacement=at(fine))
    return replace(trial, test=test, trajectory=SimpleNamespace(displacement=at))


def looped(rates=RATES):
    """Predictions of tests whose displacement is known."""
    return [replace(p, trial=moved(p.trial)) for p in pressed(rates=rates)]


@cache
def experiment(units=PAD):
    return SimpleNamespace(pad="B", trials=tuple(p.trial for p in looped()), units=units)


def table(pads="ABC"):
    """Constants of some pads with m = 1, 2, ... and intervals of a tenth."""
    known = {"m": "N/mm", "b": "1/mm", "c[0]": "1", "v[1]": "1/s", "viscous_drag.eta": "N s/mm"}
    summaries = []
    for k, pad in enumerate(pads):
        numbers = k + 1.0, 0.06, k + 1.0, (k + 0.9, k + 1.1), None, None
        found = {name: Constant(unit, *numbers) for name, unit in known.items()}
        found["noise.white"] = Constant("N", *numbers)
        summaries.append(
            FitSummary(pad=pad, effects=(), sampler="emcee", converged=True, parameters=found)
        )
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
    names |= {effect: 0.00171 + 1e-4 * rng.standard_normal(4000)} if effect else {}
    names |= {"noise.white": np.full(4000, 0.01)}
    added = effect.split(".")[0] if effect else ()
    choices = Choices(modes=modes, elastic=law, noise="white", effects=added)
    columns = np.stack(list(names.values()), axis=-1)[None]
    return Saved("B", tuple(names), columns, choices, "emcee", "", "", False, ())


def contrast(name, ratio, answer, group="constants", extrapolated=False):
    found = None if ratio is None else Interval(ratio, 0.95 * ratio, 1.05 * ratio)
    value, off = Interval(1.0, 0.9, 1.1), Interval(0.0, -0.1, 0.1)
    return Contrast(
        name, value, value, "1", off, found, 0.609, 0.2, answer, group, extrapolated
    )  # fmt: skip


def comparison(region=0.1):
    found = (
        contrast("m", 0.34, "less"), contrast("b", 2.3, "greater"), contrast("c[1]", 1.0, "equal"),
        contrast("v[2]", 0.95, "cannot tell"),
        contrast("loss tangent at 0.3 Hz about 1 mm", 1.02, "equal", "loss tangent"),
        contrast("energy lost in a cycle at 30 mm/s", 0.5, "less", "energy", extrapolated=True),
        contrast("relaxed force at 1 mm", None, "cannot tell", "force"),
    )  # fmt: skip
    return Comparison(names=("B", "C"), between="pads", region=region, contrasts=found, differ=True)


# a stiffness in N/um, and tight intervals
MANY_DIGITS = [
    Entry("B", "m", "N/um", 8.259e-4, 8.236e-4, 8.28e-4),
    Entry("B", "c[0]", "1", 0.54545, 0.54476, 0.54609),
    Entry("B", "c[1]", "1", 0.28442, 0.28353, 0.28534),
    Entry("B", "v[2]", "1/s", 1.2025, 1.1939, 1.2106),
]
LONG = "strain_dependent_strength.beta"
DRAWN = {
    "programme": lambda **w: plot_programme(experiment(), **w),
    "rates": lambda **w: plot_forces_at_rates({p: pressed(p) for p in "BC"}, PAD, **w),
    "three pads": lambda **w: plot_forces_at_rates({p: pressed(p) for p in "ABC"}, PAD, **w),
    "constants": lambda **w: plot_constants(table(), reference="Table 1", **w),
    "constants of many digits": lambda **w: plot_constants(MANY_DIGITS, **w),
    "pairs": lambda **w: plot_pairs(posterior(), **w),
    "pairs of three modes": lambda **w: plot_pairs(posterior(3), **w),
    "pairs of a linear law": lambda **w: plot_pairs(posterior(1, "linear"), **w),
    "pairs with a long name": lambda **w: plot_pairs(posterior(effect=LONG), **w),
    "a loop": lambda **w: plot_hysteresis(looped(RATES[:1]), PAD, **w),
    "loops": lambda **w: plot_hysteresis(looped(), PAD, **w),
    "contrasts": lambda **w: plot_contrasts(comparison(), **w),
}


@cache
def sheet(name, width):
    return figure_of(DRAWN[name](width=width))


@every_width
@pytest.mark.parametrize("name", DRAWN)
@pytest.mark.few(3)
def test_nothing_leaves_the_page_and_no_text_runs_into_another(name, width):
    figure = sheet(name, width)
    assert keeps_the_page(figure, width)
    assert collisions(figure) == []
    assert min(t.get_fontsize() for t in texts(figure)) >= 6.0


def labels(figure):
    names = [x.get_xlabel() for x in figure.axes] + [x.get_ylabel() for x in figure.axes]
    return {" ".join(name.split()) for name in names if name}


def test_every_axis_names_its_unit():
    time = "time since the first movement (s)"
    assert labels(sheet("programme", 85.0)) == {time, "displacement (mm)"}
    assert labels(sheet("rates", 85.0)) == {time, "force (N)"}
    assert labels(sheet("contrasts", 85.0)) == {"ratio B / C (no unit)"}
    constants = labels(sheet("constants", 85.0))
    assert {"$\\mathit{m}$ (N/mm)", "viscous_drag eta (N s/mm)", "$\\mathit{c}_{0}$"} <= constants
    pairs = labels(sheet("pairs", 180.0))
    assert {"$\\mathit{b}$ (1/mm)", "$\\mathit{v}_{2}$ (1/s)", "density"} <= pairs
    assert labels(page(plot_programme, experiment(units=STRAIN))) == {time, "strain"}


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
    assert axes[0].get_title(loc="left") == "pad B"
    for pad, fastest, axis in zip("BC", (29.3, 20.0), axes[1::2], strict=True):
        found = {p.trial.rate: p for p in predictions[pad]}
        chosen = [found[rate] for rate in (0.1, 1.0, fastest)]
        time, force = points(axis, "measured").T
        assert time == pytest.approx(np.concatenate([p.time for p in chosen]))
        assert force == pytest.approx(np.concatenate([p.observed for p in chosen]))
        bands = [c for c in axis.collections if isinstance(c, FillBetweenPolyCollection)]
        for band, p in zip(bands, chosen, strict=True):
            heights = band.get_paths()[0].vertices[:, 1]
            ends = heights.min(), heights.max()
            assert ends == pytest.approx((p.low.min(), p.high.max()))
    entries = [t.get_text() for t in figure_of(axes).legends[0].get_texts()]
    assert entries == ["0.1 mm/s", "1 mm/s", "20 mm/s to 29.3 mm/s", "90 % predictive band"]


def test_constants_stand_at_their_values_and_the_noise_is_left_out():
    axes = plot_constants(table(), reference="Table 1")
    assert len(axes) == 5
    first = axes[0]
    assert points(first, "median")[:, 0] == pytest.approx([1.0, 2.0, 3.0])
    assert points(first, "interval")[:, 0] == pytest.approx([0.9, 1.1, 1.9, 2.1, 2.9, 3.1])
    assert points(first, "reference")[:, 0] == pytest.approx([1.05])
    assert not lines(axes[1], "reference")
    assert first.texts[0].get_text() == "1.00 (0.90 to 1.10)"
    assert [t.get_text() for t in first.get_yticklabels()] == ["pad A", "pad B", "pad C"]
    assert "Table 1" in [t.get_text() for t in texts(figure_of(axes))]


def test_pairs_hold_the_draws():
    found = posterior()
    axes = plot_pairs(found)
    draws = dict(zip(found.names, found.draws.T, strict=True))
    assert len(axes) == 7 * 8 // 2
    assert lines(axes[0], "median")[0].get_xdata()[0] == pytest.approx(np.median(draws["m"]))
    outer, inner = (
        np.concatenate([path.vertices for path in region.get_paths()])
        for region in axes[1].collections
    )
    for region, quantile in ((outer, 2.146), (inner, 1.177)):  # sqrt(chi2 of 2, 0.90 and 0.50)
        half = 0.5 * np.ptp(region, axis=0)
        sds = np.array([draws[name].std() for name in ("m", "b")])
        # blurred by 1.6 bins of a range of 8 sds in 36
        assert half == pytest.approx(quantile * np.hypot(1.0, 0.35) * sds, rel=0.1)
    assert np.corrcoef(*outer.T)[0, 1] < -0.6


def test_contrasts_hold_ratios_answers_and_the_region():
    axis = plot_contrasts(comparison(region=0.2))
    assert points(axis, "median")[:, 0] == pytest.approx([0.34, 2.3, 1.0, 0.95, 1.02, 0.5])
    ends = points(axis, "interval")[:, 0].reshape(-1, 2)
    assert ends[0] == pytest.approx([0.95 * 0.34, 1.05 * 0.34])
    (shade,) = (p for p in axis.patches if p.get_gid() == "equal")
    assert (shade.get_x(), shade.get_width()) == pytest.approx((1 / 1.2, 1.2 - 1 / 1.2))
    words = [t.get_text() for t in axis.texts]
    answers = ("less", "greater", "equal", "cannot tell")
    assert [w for w in words if w in answers] == [c.answer for c in comparison().contrasts]
    assert (words.count("60.9 %"), words.count("no ratio")) == (7, 1)
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
    np.testing.assert_array_equal(points(axis, "measured").T, (place, found[0].observed))
    back = [line for line in lines(axis, "mean") if line.get_linestyle() == "--"]
    assert len(back) == 2  # unloading and the rest after it
    assert back[0].get_xdata()[0] > back[0].get_xdata()[-1]
