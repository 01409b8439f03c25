"""Forces and maps of errors: what stands where, on a page of any width, and how files are left."""

import sys
from itertools import pairwise
from pathlib import Path

import matplotlib
import msgspec
import numpy as np
import pytest
from matplotlib._pylab_helpers import Gcf
from support.figures import NOISE, page, prediction, protocol
from support.pages import drawn, keeps_the_page, points

from qlvbayes import plots
from qlvbayes.fitting.residuals import Cell, CheckResult, check
from qlvbayes.io.units import PAD
from qlvbayes.motion.phases import MOVING, Phase
from qlvbayes.plots.files import save_figure
from qlvbayes.plots.forces import plot_forces
from qlvbayes.plots.panels import PhaseTime
from qlvbayes.plots.residual_map import plot_residual_map


def paper(rates=(20.0, 0.1, 1.0)):
    """Press by 1.6 mm, hold, back by 0.8 mm, hold; the first test is the fitted one."""
    return [
        prediction(f"B-{rate}", protocol([1.6, -0.8], rate, 30.0), rate, "validate" if k else "fit")
        for k, rate in enumerate(rates)
    ]


def cycles(count):
    phases = protocol((1, -1) * count, 0.5, 18.0)
    return [prediction("cycles", phases, 0.5, "fit", force=lambda t: t)]


PROTOCOLS = {
    "paper": paper(),
    "one test": paper((0.1,)),
    "staircase": [prediction("stairs", protocol((1,) * 5, 0.05, 180.0), 0.05, force=lambda t: t)],
    "more cycles than fit": cycles(9),
    "a rest first": [
        prediction("w", (Phase("hold", 0.0, 0.5), *protocol([1.6], 20.0, 30.0, 0.5)), 20.0)
    ],
    "rest of less than a decade": [
        prediction("few", (Phase("ramp", 0.0, 1.0), Phase("hold", 1.0, 9.0)), np.nan,
                   time=np.array([0.0, 0.5, 3.0, 5.0, 7.0, 9.0]))
    ],
    "no sample in the ramp": [
        prediction("coarse", protocol([1.0], 100.0, 30.0), 100.0, time=np.arange(1.0, 30.0))
    ],
    "huge forces": [prediction("huge", protocol([1.0], 1.0, 9.0), 1.0, force=lambda t: 1e6 * t)],
    "long name": [prediction("mavacamten-" * 12, protocol([1.0], 1.0, 9.0), 1.0)],
}  # fmt: skip

every_width = pytest.mark.parametrize("width", [85.0, 180.0])
every_protocol = pytest.mark.parametrize("predictions", PROTOCOLS.values(), ids=PROTOCOLS)


@pytest.mark.parametrize("wide", [60.0, 160.0])
@every_protocol
def test_time_is_linear_in_movements_logarithmic_in_rests_and_never_turns_back(predictions, wide):
    for one in predictions:
        time = PhaseTime.of(one.trial, wide)
        phases = one.trial.phases
        whole = np.linspace(phases[0].start, phases[-1].stop, 4001)
        assert np.all(np.diff(time(whole)) >= 0.0)
        if not time.side_by_side:
            assert 6.0 * len(phases) > wide
            assert np.array_equal(time(whole), whole)
            continue
        for k, phase in enumerate(phases):
            length = phase.stop - phase.start
            quarter, half, end = (
                (time(np.array([phase.start + share * length]))[0] - time.edges[k])
                / (time.edges[k + 1] - time.edges[k])
                for share in (0.25, 0.5, 1.0 - 1e-9)
            )
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


def cell(test="a", rate=1.0, phase="ramp", rmse=NOISE, bias=0.0, p=0.5, role="validate"):
    return Cell(test, role, rate, phase, 9, rmse, bias, 0.9, p, fails=p < 0.01)


def checked(cells, noise=NOISE):
    return CheckResult(pad="B", noise=noise, cells=tuple(cells))


def squares(figure):
    """Place (row, column) of each square of the map, with its patch."""
    return {(round(p.get_y()), round(p.get_x())): p for p in figure.axes[0].patches}


def test_failing_cells_and_only_they_are_framed():
    cells = (
        cell("slow", 0.1), cell("slow", 0.1, "hold", 5 * NOISE, p=1e-9),
        cell("quick", 9.0, "unload", 5 * NOISE), cell("quick", 9.0, "recovery", p=1e-4),
    )  # fmt: skip
    figure = page(plot_residual_map, checked(cells), PAD)
    framed = {place for place, p in squares(figure).items() if p.get_gid() == "fails"}
    assert framed == {(0, 1), (1, 3)}
    assert all(squares(figure)[place].get_linewidth() > 1.0 for place in framed)
    assert [t.get_text() for t in figure.axes[0].texts].count("×") == 2


@every_protocol
@pytest.mark.few(1)
def test_the_map_of_any_protocol_stays_on_the_page(predictions):
    found = check("B", NOISE, predictions)
    for noise, width in ((NOISE, 120.0), (0.0, 85.0), (1e-7, 120.0)):
        changed = msgspec.structs.replace(found, noise=noise)
        assert keeps_the_page(page(plot_residual_map, changed, PAD, width=width), width)


def test_files_are_whole_repeatable_and_hold_their_fonts(tmp_path):
    shown = PROTOCOLS["staircase"]
    image = save_figure(page(plot_forces, shown, PAD), tmp_path / "pad.1")
    document = tmp_path / "pad.1.pdf"
    assert sorted(tmp_path.iterdir()) == [document, image]
    first = image.read_bytes(), document.read_bytes()
    assert first[0].startswith(b"\x89PNG\r\n\x1a\n")
    assert first[0].endswith(b"IEND\xaeB`\x82")
    assert first[1].startswith(b"%PDF-")
    assert first[1].endswith(b"%%EOF\n")
    assert b"/FontFile2" in first[1]
    assert b"/Type3" not in first[1]
    save_figure(page(plot_forces, shown, PAD), tmp_path / "pad.1")
    assert (image.read_bytes(), document.read_bytes()) == first


def test_a_user_s_settings_and_windows_are_left_alone(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)  # importing it would now fail
    before = dict(matplotlib.rcParams.copy())
    save_figure(page(plot_forces, paper(), PAD), tmp_path / "forces")
    save_figure(page(plot_residual_map, check("B", NOISE, paper()), PAD), tmp_path / "map")
    assert dict(matplotlib.rcParams.copy()) == before
    assert Gcf.get_num_fig_managers() == 0
    sources = Path(plots.__file__).parent.glob("*.py")
    assert not any("pyplot" in source.read_text(encoding="utf-8") for source in sources)
