import sys
from itertools import pairwise
from pathlib import Path

import matplotlib
import msgspec
import numpy as np
import pytest
from matplotlib._pylab_helpers import Gcf
from matplotlib.collections import FillBetweenPolyCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from support.figures import DWELLS, NOISE, drawn, page, prediction, protocol

from qlvbayes import plots
from qlvbayes.fitting.residuals import Cell, CheckResult, check
from qlvbayes.io.units import PAD, STRAIN
from qlvbayes.motion.phases import KINDS, Phase
from qlvbayes.plots.files import save_figure
from qlvbayes.plots.forces import plot_forces
from qlvbayes.plots.residual_map import plot_residual_map


def paper(rates=(20.0, 0.1, 1.0)):
    """Press by 1.6 mm, hold, back by 0.8 mm, hold; the first test is the fitted one."""
    return [
        prediction(f"B-{rate}", protocol([1.6, -0.8], rate, 30.0), rate, "validate" if k else "fit")
        for k, rate in enumerate(rates)
    ]


def stairs(moves=(1, 1, 1, 1, 1)):
    return [prediction("stairs", protocol(moves, 0.05, 180.0), 0.05, "fit", force=lambda t: t)]


def waited():
    """A rest of 0.5 s before a ramp of 80 ms."""
    return [prediction("w", (Phase("hold", 0.0, 0.5), *protocol([1.6], 20.0, 30.0, 0.5)), 20.0)]


PROTOCOLS = {
    "paper": paper(),
    "one test": paper((0.1,)),
    "staircase": stairs(),
    "up and down": stairs((1, 1, 1, -1, -1, -1)),
    "brief rest": [prediction("brief", protocol([1.0], 1.0, 1e-3), 1.0)],
    "rest of less than a decade": [
        prediction("few", (Phase("ramp", 0.0, 1.0), Phase("hold", 1.0, 9.0)), np.nan,
                   time=np.array([0.0, 0.5, 3.0, 5.0, 7.0, 9.0]))
    ],
    "other phases": [*paper((0.1,)), prediction("ramp only", (Phase("ramp", 0.0, 2.0),), 0.8)],
    "no sample in the ramp": [
        prediction("coarse", protocol([1.0], 100.0, 30.0), 100.0, time=np.arange(1.0, 30.0))
    ],
    "huge forces": [prediction("huge", protocol([1.0], 1.0, 9.0), 1.0, force=lambda t: 1e6 * t)],
    "long name": [prediction("mavacamten-" * 12, protocol([1.0], 1.0, 9.0), 1.0)],
}  # fmt: skip

every_width = pytest.mark.parametrize("width", [85.0, 180.0])
every_protocol = pytest.mark.parametrize("predictions", PROTOCOLS.values(), ids=PROTOCOLS)


def grid(figure):
    """Panels that show something, by row and column."""
    cells = {axis: axis.get_subplotspec() for axis in figure.axes if axis.lines}
    return {(c.rowspan.start, c.colspan.start): axis for axis, c in cells.items()}


def measured(axis):
    return np.concatenate([x.get_xydata() for x in axis.lines if x.get_marker() == "."])


def band(axis):
    areas = [c for c in axis.collections if isinstance(c, FillBetweenPolyCollection)]
    return np.concatenate([path.vertices for area in areas for path in area.get_paths()])


def ink_stays_on_the_page(figure):
    ink = figure.get_tightbbox(drawn(figure)).extents
    page = figure.bbox_inches.extents
    return np.all(ink[:2] >= page[:2]) and np.all(ink[2:] <= page[2:])


def test_one_row_a_test_by_rate_and_one_column_a_phase():
    figure = page(plot_forces, paper((20.0, 0.1, 1.0)), PAD)
    panels = grid(figure)
    assert sorted(panels) == [(row, column) for row in range(3) for column in range(4)]
    assert [panels[0, k].get_title().strip() for k in range(4)] == list(KINDS)
    rows = [panels[k, 0].get_title(loc="left") for k in range(3)]
    assert rows == [
        "B-0.1, 0.1 mm/s, predicted", "B-1.0, 1 mm/s, predicted", "B-20.0, 20 mm/s, fitted",
    ]  # fmt: skip


@every_protocol
def test_rests_run_in_logarithmic_and_movements_in_linear_time(predictions):
    for axis in grid(page(plot_forces, predictions, PAD)).values():
        rest = any(f"time in {kind}" in axis.get_xlabel() for kind in DWELLS)
        assert axis.get_xscale() == ("log" if rest else "linear")


def test_axes_name_their_units():
    for units, force in ((PAD, "force (N)"), (STRAIN, "stress (kPa)")):
        panels = grid(page(plot_forces, paper((0.1, 20.0)), units))
        assert {panels[k, 0].get_ylabel() for k in range(2)} == {force}
        assert panels[0, 0].get_xlabel() == "time in ramp (s)"
        assert panels[1, 0].get_xlabel() == "time in ramp (ms)"
        assert panels[1, 1].get_xlabel() == "time in hold (s)"
    strain = grid(page(plot_forces, paper((0.226,)), STRAIN))
    assert strain[0, 0].get_title(loc="left") == "B-0.226, 0.226/s, fitted"


@every_protocol
def test_every_sample_and_band_is_in_view(predictions):
    figure = page(plot_forces, predictions, PAD)
    drawn(figure)
    panels = grid(figure)
    for row in {place[0] for place in panels}:
        phases = [a for (r, _), a in panels.items() if r == row and "in" in a.get_xlabel()]
        shown = sum(len(measured(axis)) for axis in phases)
        assert shown in [p.time.size for p in predictions]
    for axis in panels.values():
        for points in (measured(axis), band(axis)):
            (left, right), (bottom, top) = axis.get_xlim(), axis.get_ylim()
            assert np.all((points[:, 0] >= left) & (points[:, 0] <= right))
            assert np.all((points[:, 1] >= bottom) & (points[:, 1] <= top))


@every_width
@every_protocol
@pytest.mark.few(6)
def test_no_text_leaves_the_page(predictions, width):
    assert ink_stays_on_the_page(page(plot_forces, predictions, PAD, width=width))


@every_width
@every_protocol
@pytest.mark.few(6)
def test_tick_labels_do_not_touch(predictions, width):
    figure = page(plot_forces, predictions, PAD, width=width)
    renderer = drawn(figure)
    for axis in figure.axes:
        left, right = axis.get_xlim()
        ticks = [t for t in axis.xaxis.get_major_ticks() if left <= t.get_loc() <= right]
        boxes = [t.label1.get_window_extent(renderer) for t in ticks if t.label1.get_text()]
        assert len(boxes) >= 2 or not axis.lines
        assert all(a.x1 < b.x0 for a, b in pairwise(boxes))


def test_a_staircase_shows_the_whole_test_and_numbers_its_steps():
    panels = grid(page(plot_forces, stairs(), PAD))
    assert [panels[0, k].get_title().strip() for k in range(3)] == ["whole test", "ramp", "hold"]
    whole = measured(panels[0, 0])
    assert whole[:, 0].max() == stairs()[0].time[-1]
    for k in (1, 2):
        assert [text.get_text() for text in panels[0, k].texts] == list("12345")


def test_a_sample_taken_as_the_motion_stops_leaves_the_time_axis_alone():
    phases = protocol([1.0], 1.0, 30.0)
    time = np.concatenate([np.arange(0.0, 1.0, 0.1), [1.0 + 1e-12], np.arange(1.1, 31.0, 0.1)])
    panels = grid(page(plot_forces, [prediction("x", phases, 1.0, time=time)], PAD))
    assert panels[0, 1].get_xlim()[0] > 0.05
    assert len(measured(panels[0, 0])) == 11


def test_a_rest_before_the_ramp_does_not_squeeze_it():
    ramp = grid(page(plot_forces, waited(), PAD))[0, 0]
    left, right = ramp.get_xlim()
    assert -0.15 * 80.0 < left < 0.0
    assert right > 75.0
    assert measured(ramp)[:, 0].min() < -400.0


def cell(test="a", rate=1.0, phase="ramp", rmse=NOISE, bias=0.0, p=0.5, role="validate"):
    return Cell(test, role, rate, phase, 9, rmse, bias, 0.9, p, fails=p < 0.01)


def checked(cells, noise=NOISE):
    return CheckResult(pad="B", noise=noise, cells=tuple(cells))


def squares(figure):
    """Place (row, column) of each square of the map, with its patch."""
    patches = [p for p in figure.axes[0].patches if p.get_width() < 1.0]
    return {(round(p.get_y()), round(p.get_x())): p for p in patches}


def lightness(patch):
    return np.dot(to_rgb(patch.get_facecolor()), [0.299, 0.587, 0.114])


def test_failing_cells_and_only_they_are_framed():
    cells = (
        cell("slow", 0.1), cell("slow", 0.1, "hold", 5 * NOISE, p=1e-9),
        cell("quick", 9.0, "unload", 5 * NOISE), cell("quick", 9.0, "recovery", p=1e-4),
    )  # fmt: skip
    found = checked(cells)
    figure = page(plot_residual_map, found, PAD)
    framed = {place for place, p in squares(figure).items() if p.get_gid() == "fails"}
    assert framed == {(0, 1), (1, 3)}
    assert all(squares(figure)[place].get_linewidth() > 1.0 for place in framed)
    assert [t.get_text() for t in figure.axes[0].texts].count("×") == 2


def test_a_worse_cell_is_darker_also_in_grey():
    ratios = (0.3, 1.0, 1.5, 3.0, 9.0, 40.0)
    cells = tuple(cell(f"t{k}", float(k), rmse=r * NOISE) for k, r in enumerate(ratios))
    shown = squares(page(plot_residual_map, checked(cells), PAD))
    light = [lightness(shown[k, 0]) for k in range(len(ratios))]
    assert light[0] == light[1]
    assert np.all(np.diff(light[1:]) < -0.02)


def test_cells_say_ratio_and_signed_bias_and_empty_ones_are_hatched():
    cells = (cell(rmse=2.12 * NOISE, bias=-0.0208), cell(phase="hold", rmse=1.23, bias=0.5))
    figure = page(plot_residual_map, checked(cells), PAD)
    axis = figure.axes[0]
    assert [t.get_text() for t in axis.texts] == ["2.12\n−0.021", "123\n+0.5"]
    hatched = {place for place, p in squares(figure).items() if p.get_hatch()}
    assert hatched == {(0, 2), (0, 3)}
    assert "hatched: no samples" in figure.get_supxlabel()


def test_the_map_names_tests_by_rate_roles_and_units():
    cells = (cell("b", 3.0, role="fit"), cell("a", 0.5), cell("none", None))
    figure = page(plot_residual_map, checked(cells, 0.0123), STRAIN)
    axis, bar = figure.axes
    labels = axis.get_yticklabels()
    assert [t.get_text() for t in labels] == [
        "a\n0.5/s, predicted", "b\n3/s, fitted", "none\npredicted",
    ]  # fmt: skip
    assert [t.get_fontweight() for t in labels] == ["normal", "bold", "normal"]
    assert "measured − predicted (kPa)" in figure.get_supxlabel()
    assert "(1 = 0.0123 kPa)" in bar.get_ylabel()
    assert bar.get_ylim() == pytest.approx((1.0, 10.0))


@every_protocol
@pytest.mark.few(3)
def test_the_map_of_any_protocol_stays_on_the_page(predictions):
    found = check("B", NOISE, predictions)
    figure = page(plot_residual_map, found, PAD)
    assert ink_stays_on_the_page(figure)
    bar = figure.axes[1]
    assert bar.yaxis.label.get_window_extent().height < figure.bbox.height
    for noise in (0.0, 1e-7):
        for width in (85.0, 120.0):
            changed = msgspec.structs.replace(found, noise=noise)
            assert ink_stays_on_the_page(page(plot_residual_map, changed, PAD, width=width))


def test_files_are_whole_repeatable_and_hold_their_fonts(tmp_path):
    image = save_figure(page(plot_forces, stairs(), PAD), tmp_path / "pad.1")
    document = tmp_path / "pad.1.pdf"
    assert sorted(tmp_path.iterdir()) == [document, image]
    first = image.read_bytes(), document.read_bytes()
    assert first[0].startswith(b"\x89PNG\r\n\x1a\n")
    assert first[0].endswith(b"IEND\xaeB`\x82")
    assert first[1].startswith(b"%PDF-")
    assert first[1].endswith(b"%%EOF\n")
    assert b"/FontFile2" in first[1]
    assert b"/Type3" not in first[1]
    save_figure(page(plot_forces, stairs(), PAD), tmp_path / "pad.1")
    assert (image.read_bytes(), document.read_bytes()) == first


def test_a_write_that_breaks_off_leaves_the_older_file(tmp_path, monkeypatch):
    figure = page(plot_residual_map, checked((cell(),)), PAD)
    image = save_figure(figure, tmp_path / "map")
    older = {path: path.read_bytes() for path in tmp_path.iterdir()}

    def full(self, part, **_):
        Path(part).write_bytes(b"half")
        raise OSError("disk full")

    monkeypatch.setattr(Figure, "savefig", full)
    with pytest.raises(OSError, match="disk full"):
        save_figure(figure, image.with_name("map"))
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == older


def test_a_user_s_settings_and_windows_are_left_alone(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)  # importing it would now fail
    before = dict(matplotlib.rcParams.copy())
    found = check("B", NOISE, paper())
    save_figure(page(plot_forces, paper(), PAD), tmp_path / "forces")
    save_figure(page(plot_residual_map, found, PAD), tmp_path / "map")
    assert dict(matplotlib.rcParams.copy()) == before
    assert Gcf.get_num_fig_managers() == 0
    sources = Path(plots.__file__).parent.glob("*.py")
    assert not any("pyplot" in source.read_text(encoding="utf-8") for source in sources)
