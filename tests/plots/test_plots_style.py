"""The list of figures; a look of one's own, in Python and as a file; how figures are imported."""

import re
import subprocess
import sys
from pathlib import Path

import matplotlib
import pytest

from qlvbayes import plots
from qlvbayes.fitting.residuals import Cell, CheckResult
from qlvbayes.io.checks import InputError
from qlvbayes.io.units import PAD
from qlvbayes.plots.catalogue import FIGURES
from qlvbayes.plots.style import COLOURS, colours, style, using

FOLDER = Path(plots.__file__).parent
TEMPLATES = FOLDER.parent / "report" / "templates"


def test_every_figure_is_listed_once():
    texts = [(path.stem, path.read_text()) for path in FOLDER.glob("*.py")]
    found = [(stem, name) for stem, text in texts for name in re.findall(r"\ndef plot_(\w+)", text)]
    assert sorted(found) == sorted((one.file or one.name, one.name) for one in FIGURES)
    assert {f"plot_{name}" for _, name in found} <= set(plots.__all__)


@pytest.mark.parametrize("figure", [one for one in FIGURES if one.shows], ids=lambda one: one.name)
def test_the_report_shows_every_figure_that_has_words(figure):
    text = "".join(path.read_text() for path in TEMPLATES.glob("*.j2"))
    assert re.search(rf"(figures|pad\.folder\])\.{figure.name}\b|figure\({figure.name}\)", text)
    assert figure.see
    assert ("{of}" in figure.shows) == (figure.takes is not None or figure.command == "compare")


def test_public_figures_are_had_from_the_package_which_draws_nothing_in():
    for name in plots.__all__:
        value = getattr(plots, name)
        assert value.__name__ == name
        assert value.__doc__
    with pytest.raises(AttributeError, match="plot_nothing"):
        plots.plot_nothing  # noqa: B018
    code = (
        "import sys, qlvbayes.plots, qlvbayes.cli.main; print('matplotlib.figure' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


def test_settings_go_over_the_package_s_and_come_back():
    with using(
        {"font.size": 11.0, "axes.labelsize": 12.0, "axes.prop_cycle": "cycler('color', 'rk')"}
    ):
        with using({"font.size": 13.0}), style():
            assert matplotlib.rcParams["font.size"] == 13.0
            assert matplotlib.rcParams["axes.labelsize"] == 12.0
            assert colours() == ("r", "k", *COLOURS[2:])
        cell = Cell("a", "fit", 1.0, "ramp", 9, 0.02, 0.0, 0.9, 0.5)
        axis = plots.plot_residual_map(CheckResult(pad="B", noise=0.01, cells=(cell,)), PAD)
        assert plots.figure_of(axis).axes[1].yaxis.label.get_size() == 12.0
    with style():
        assert matplotlib.rcParams["font.size"] == 7.5
        assert colours() == COLOURS


def test_a_file_and_a_named_style_can_be_used_and_what_is_no_look_is_refused(tmp_path):
    file = tmp_path / "mine.mplstyle"
    text = '# mine\nfont.size: 10  # larger\naxes.edgecolor: "#555555"\nbackend: pdf\n'
    file.write_text(text)
    with using(file), style():
        assert matplotlib.rcParams["font.size"] == 10.0
        assert matplotlib.rcParams["axes.edgecolor"] == "#555555"
    with using("grayscale"), style():
        assert colours()[0] == "0.00"
        assert matplotlib.rcParams["pdf.fonttype"] == 42
    with pytest.raises(InputError, match="cannot be read"), using(tmp_path / "none.mplstyle"):
        pass
    with pytest.raises(InputError, match="not settings of Matplotlib"), using({"font.sise": 9}):
        pass


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("font.size: 9\nfont.sise: 9\n", "line 2: Matplotlib has no setting 'font.sise'"),
        ("font.size 9\n", "line 1: no colon"),
        ("\nfont.size: large-ish\n", "line 2: not a style"),
    ],
)
def test_a_file_that_is_no_style_is_refused_with_its_line(tmp_path, text, said):
    file = tmp_path / "bad.mplstyle"
    file.write_text(text)
    with pytest.raises(InputError, match=f"bad.mplstyle, {said}"), using(file):
        pass
