import dataclasses
from functools import cache
from unittest.mock import patch

import numpy as np
import pytest
from msgspec.structs import replace
from support.figures import page, prediction, protocol
from support.hidden_pads import FEW, hidden_pad
from support.pages import collisions, drawn, keeps_the_page, lines, texts

from qlvbayes.diagnosis.diagnose import diagnose
from qlvbayes.diagnosis.result import (
    Base,
    CellError,
    DiagnosisResult,
    Excluded,
    LawPair,
    Ranked,
    Stage,
    StructuredPhase,
    Used,
    Worst,
)
from qlvbayes.diagnosis.settings import DiagnosisSettings
from qlvbayes.diagnosis.summary.diagnosis import Curve, Diagnosis, ForceBand, curves
from qlvbayes.effects.catalogue import names
from qlvbayes.io.units import STRAIN
from qlvbayes.plots import forces
from qlvbayes.plots.evidence import plot_error_staircase, plot_evidence
from qlvbayes.plots.forces import plot_forces_before_after
from qlvbayes.plots.residual_map import plot_residuals_before_after
from qlvbayes.simulate import TABLE_1
from qlvbayes.simulate.hidden import draw_effect

NOISE = 0.01
KINDS = ("ramp", "hold", "unload", "recovery")


def cells(tests, ratio):
    return tuple(
        CellError(test, phase, rate, 9, ratio * NOISE, 0.0)
        for rate, test in enumerate(tests, 1)
        for phase in KINDS
    )


LAWS = ("exponential", "prony:2")
USED = Used(DiagnosisSettings(), 0, LAWS[:1], LAWS[1:], ("viscous_drag",))


def stage(effects, tests, ratio, failing=(), base=LAWS):
    p = 1e-9 if failing else 0.5
    errors = ratio * NOISE, 1.2 * ratio * NOISE
    found, places = cells(tests, ratio), tuple(StructuredPhase(*place) for place in failing)
    return Stage(LawPair(*base), tuple(effects), *errors, -1.0, p, True, places, found, {})


def ranking(best):
    """Every effect, ``best`` first."""
    values = np.linspace(900.0, -5.0, len(names()))
    order = sorted(names(), key=lambda name: name != best)
    effects = [
        Ranked(name, *2 * (1.0 if name == best else 0.0,), value, 0.01, {})
        for name, value in zip(order, values, strict=True)
    ]
    return (*effects[:-5], Ranked("none", 0.0, 0.0, 0.0, 0.05, {}), *effects[-5:])


def diagnosed(count=3, added=("viscous_drag",), verdict="missing_effect", **changes):
    """Return a result written by hand, with as many steps as effects were added."""
    tests = [f"test-{k}" for k in range(count)]
    steps = [added[:k] for k in range(len(added) + 1)]
    failing = [(tests[0], "ramp"), (tests[-1], "hold")] if added else []
    stages = [stage(e, tests, 12.0 / (1 + k) ** 2) for k, e in enumerate(steps)]
    stages[0] = stage((), tests, 12.0 if added else 1.0, failing)
    found = DiagnosisResult(
        pad="B", noise=NOISE, verdict=verdict, effects=tuple(added), group=tuple(added[-1:]),
        base=Base(*LAWS, 0.99), bases=(Base(*LAWS, 0.99),), alternatives=(), outside=0.0,
        stages=tuple(stages), ranking=ranking(added[-1] if added else "friction"),
        not_identifiable=(Excluded("own_effect", "no test unloads"),), biases=(),
        worst=Worst(tests[0], "ramp", 12.0 * NOISE, 0.0), settings=USED,
    )  # fmt: skip
    return replace(found, **changes)


def curve(predicted, added=True):
    """Curves of a hand-made prediction: the plain model is off by five times the noise."""
    mean, n = predicted.mean, predicted.mean.size
    final = ForceBand(mean, predicted.low, predicted.high)
    plain = ForceBand(mean + 0.05, predicted.low + 0.05, predicted.high + 0.05) if added else final
    return Curve(
        predicted.trial, predicted.time, predicted.phase, predicted.observed,
        np.full(n, NOISE), plain, final,
    )  # fmt: skip


def pressed(count, added=True, name="test", moves=(1.6, -0.8)):
    phases = protocol(moves, 20.0, 30.0)
    return [curve(prediction(f"{name}-{k}", phases, 20.0 + k), added) for k in range(count)]


def stairs():
    phases = protocol([1, 1, 1, 1], 0.05, 180.0)
    return [curve(prediction("stairs", phases, 0.05, force=lambda t: t))]


MANY = ("strain_dependent_strength", "viscous_drag", "extra_relaxation_mode", "frame_compliance")
CASES = {
    "one effect": (diagnosed(), pressed(3)),
    "nothing missing": (
        diagnosed(2, (), "adequate", pad="a pad whose name needs another line " * 2),
        pressed(2, False),
    ),
    "one test": (diagnosed(1), pressed(1)),
    "twelve tests, four effects": (diagnosed(12, MANY), pressed(12, moves=[1.6])),
    "staircase": (diagnosed(1), stairs()),
    "ambiguous, long names": (
        diagnosed(2, MANY[:1], "ambiguous", group=(MANY[0], *MANY[2:]), pad="mavacamten-" * 12),
        pressed(2, name="calcium" * 9),
    ),
    "partly explained": (diagnosed(verdict="partly_explained", group=()), pressed(3)),
    "unexplained stress": (
        diagnosed(verdict="unexplained", effects=(), group=(), units=STRAIN), pressed(3)
    ),
}  # fmt: skip
QUICK = ("one effect", 85.0)
every_case_and_width = pytest.mark.parametrize(
    ("case", "width"),
    [
        # the others take as long again
        pytest.param(case, width, marks=() if (case, width) == QUICK else pytest.mark.slow)
        for case in CASES
        for width in (85.0, 180.0)
    ],
)


def forces_of(found, shown, **options):
    """The figure of curves that were made by hand."""
    with patch.object(forces, "curves", lambda diagnosis: shown):
        return plot_forces_before_after(Diagnosis(found, None), **options)


@cache
def pages(case, width=180.0):
    """The four figures of a case, drawn once."""
    found, shown = CASES[case]
    return (
        page(plot_residuals_before_after, found, width=width),
        page(forces_of, found, shown, width=width),
        page(plot_evidence, found, width=width),
        page(plot_error_staircase, found, width=width),
    )


def words(figure):
    return "\n".join(t.get_text() for t in texts(figure))


@every_case_and_width
def test_nothing_leaves_the_page_or_overlaps_and_type_can_be_read(case, width):
    for k, figure in enumerate(pages(case, width)):
        assert keeps_the_page(figure, width)
        assert min(t.get_fontsize() for t in texts(figure)) >= 6.0
        if k != 1 and width == 85.0 and case in ("one effect", "twelve tests, four effects"):
            assert collisions(figure) == []
        renderer = drawn(figure)
        inside = [axis.get_tightbbox(renderer) for axis in figure.axes]
        inside = [box for box in inside if box is not None]
        outside = [legend.get_window_extent(renderer) for legend in figure.legends]
        written = [figure._suptitle, figure._supxlabel]
        outside += [text.get_window_extent(renderer) for text in written if text]
        for n, box in enumerate(outside):
            for other in [*outside[n + 1 :], *inside]:
                assert not box.padded(-1.0).overlaps(other)


@pytest.mark.parametrize("case", ["one effect", "unexplained stress"])
def test_every_axis_names_its_unit(case):
    unit = CASES[case][0].units.force
    residuals, forces, evidence, staircase = pages(case)
    assert f"(1 = 0.01 {unit})" in residuals.axes[-1].get_ylabel()
    assert {axis.get_ylabel() for axis in forces.axes[1::2]} == {f"residual\n({unit})"}
    assert all(axis.get_ylabel().endswith(f"({unit})") for axis in forces.axes[::2])
    assert "(s)" in next(t.get_text() for t in forces.texts if t.get_gid() == "time")
    assert "no unit" in evidence.axes[0].get_xlabel()
    assert f"({unit})" in staircase.axes[0].get_xlabel()
    assert f"noise floor, 0.0100 {unit}" in words(staircase)


def test_both_maps_share_their_scale_and_leave_it_to_the_check_what_fails():
    found = diagnosed(3)
    figure = page(plot_residuals_before_after, found)
    before, after, bar = figure.axes
    assert bar.get_ylim()[1] == pytest.approx(12.0)
    assert before.get_title(loc="left") == "plain model\nadequacy p < 0.0001"
    assert after.get_title(loc="left") == "with viscous_drag\nadequacy p = 0.50"
    assert not [p for axis in (before, after) for p in axis.patches if p.get_gid() == "fails"]
    assert [t.get_text() for t in after.texts] == ["3.00"] * 12
    assert [t.get_text() for t in before.texts] == ["12.0"] * 12


def test_a_strip_shows_what_each_model_leaves_over_the_noise():
    (shown,) = pressed(1)
    figure = page(forces_of, diagnosed(1), [shown])
    strip = figure.axes[1]
    plain, final = (line.get_ydata() for line in lines(strip, "residual"))
    assert final == pytest.approx(shown.observed - shown.final.mean)
    assert plain == pytest.approx(final - 0.05)
    (noise,) = (c for c in strip.collections if c.get_gid() == "noise")
    assert np.ptp(noise.get_paths()[0].vertices[:, 1]) == pytest.approx(2 * 1.645 * NOISE, rel=1e-3)
    assert strip.get_xlim() == figure.axes[0].get_xlim()


def bars(figure):
    """Width and look of each bar by its label."""
    axis = figure.axes[0]
    labels = [t.get_text() for t in axis.get_yticklabels()]
    return {n: (p.get_width(), p.get_gid()) for n, p in zip(labels, axis.patches, strict=True)}


def test_a_group_is_framed_and_refused_effects_are_crossed():
    found = diagnosed(verdict="ambiguous", group=("viscous_drag", "friction"))
    figure = page(plot_evidence, found)
    assert bars(figure)["friction"][1] == "explains these tests as well"
    assert "one of viscous_drag, friction" in words(figure)
    order = ("friction", *(n for n in names() if n != "friction"))
    ranks = {r.effect: r for r in found.ranking}
    above = replace(
        diagnosed(verdict="unexplained", effects=(), group=()),
        ranking=tuple(ranks[n] for n in order),
        refused=(Excluded("friction", "it predicts no better"),),
    )  # fmt: skip
    figure = page(plot_evidence, above)
    assert "friction ×" in bars(figure)
    assert bars(figure)["viscous_drag"][1] == "added, but structure is left"


def test_stairs_hold_both_errors_and_the_floor():
    found = diagnosed(3, MANY)
    axis = page(plot_error_staircase, found).axes[0]
    fitted, heldout = (s.get_data().values for s in axis.patches)
    assert list(fitted) == [s.rmse for s in found.stages]
    assert list(heldout) == [s.heldout_rmse for s in found.stages]
    assert any(np.all(np.asarray(line.get_xdata()) == NOISE) for line in axis.lines)
    labels = [t.get_text() for t in axis.get_yticklabels()]
    assert labels[:3] == ["plain model", "+ strain_dependent_strength", "+ viscous_drag"]


@pytest.mark.slow
def test_curves_hold_errors_and_readings_and_measured_sds_shape_the_band():
    """Of three short tests of a pad with drag, diagnosed with few candidates."""
    constants = TABLE_1["B"]
    peak = constants.m / constants.b * np.expm1(1.6 * constants.b)
    drag = draw_effect("viscous_drag", np.random.default_rng(1), peak, 1.6, 40.0, 0.1,
                       constants=constants)  # fmt: skip
    real = diagnose(hidden_pad(drag, rates=(1.0, 20.0, 100.0), seed=1), kinds=FEW)
    shown = curves(real)
    assert real.result.tried == ("viscous_drag",)
    for model, stage in (("baseline", real.result.stages[0]), ("final", real.result.stages[-1])):
        left = np.concatenate([c.observed - getattr(c, model).mean for c in shown])
        assert np.sqrt(np.mean(left**2)) == pytest.approx(stage.rmse, rel=1e-6)
    for c in shown:
        assert c.time.shape == c.phase.shape == c.observed.shape == c.floor.shape
        assert np.all(c.final.low < c.final.mean)
        assert np.all(c.final.mean < c.final.high)
        assert c.floor == pytest.approx(real.result.noise)
    # of all tests, as correlated noise wanders within one
    inside = [(c.observed > c.final.low) & (c.observed < c.final.high) for c in shown]
    assert 0.8 < np.concatenate(inside).mean() < 0.98
    samples, floor = real.work.samples, real.work.experiment.floor
    noisier = tuple(3.0 * weights for weights in samples.weights)
    work = dataclasses.replace(real.work, samples=dataclasses.replace(samples, weights=noisier))
    shown = curves(Diagnosis(real.result, work), draws=20)
    assert shown[0].floor == pytest.approx(np.hypot(3.0 * floor.white, floor.ou))
    wider = [np.mean(c.final.high - c.final.low) for c in (shown[0], curves(real)[0])]
    assert wider[0] > 1.3 * wider[1]
