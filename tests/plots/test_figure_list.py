"""The list of figures is complete, and the report shows all that it has words for."""

import re
from pathlib import Path

import pytest

from qlvbayes import plots
from qlvbayes.plots.catalogue import FIGURES, figures_of

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
    assert f"figures.{figure.name}" in text or f"figure({figure.name})" in text
    assert figure.see
    assert ("{of}" in figure.shows) == (figure.takes is not None or figure.command == "compare")


def test_a_figure_of_all_pads_is_not_drawn_for_one():
    (constants,) = (one for one in FIGURES if one.name == "constants")
    assert constants not in figures_of("fit")
    with pytest.raises(TypeError, match="constants is not a figure of one pad"):
        constants.draw(None)
