"""The examples of the pages on one's own parts and on prediction do what is said of them."""

import re
from pathlib import Path

import numpy as np
import pytest
from support.endtoend import SHORT, experiment, fitted
from support.pages import keeps_the_page

from qlvbayes.fitting import fit
from qlvbayes.fitting.ensemble import Settings
from qlvbayes.model.choices import Choices
from qlvbayes.plots import figure_of, save_figure

TEXT = (Path(__file__).parents[2] / "docs" / "own.md").read_text()


def example(name):
    """Return what an example that stands alone defines by that name."""
    blocks = re.findall(r"```python\n(.*?)```", TEXT, flags=re.DOTALL)
    found = {}
    exec(next(block for block in blocks if f"def {name}(" in block), found)
    return found[name]


@pytest.mark.slow
def test_a_sampler_finds_the_posterior_that_emcee_finds(monkeypatch):
    monkeypatch.setitem(fit.SAMPLERS, "metropolis", example("metropolis"))
    found = fit.fit_pad(
        experiment(), Choices(), method="metropolis", settings=Settings(max_steps=1500)
    )
    assert found.method == "metropolis"
    known = fitted()
    theirs, ours = known.summary(), found.summary()
    free = [name for name in known.names if not theirs[name].fixed]
    assert len(free) > 5
    for name in free:
        sizes = [s[name].ess_bulk for s in (theirs, ours)]
        error = theirs[name].sd * np.sqrt(sum(1.0 / size for size in sizes))
        assert abs(ours[name].mean - theirs[name].mean) < 5.0 * error, name


def test_a_figure_is_drawn_and_saved(tmp_path):
    axis = example("plot_strengths")(fitted(settings=SHORT), width=85.0)
    assert keeps_the_page(figure_of(axis), 85.0)
    assert sum(bar.get_height() * bar.get_width() for bar in axis.patches) == pytest.approx(1.0)
    assert save_figure(axis, tmp_path / "strengths").read_bytes()[:4] == b"\x89PNG"


ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def ran():
    """The page's names once its code has run."""
    text = (ROOT / "docs" / "prediction.md").read_text(encoding="utf-8")
    names = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(ROOT)
        for code in re.findall(r"```python\n(.*?)```", text, re.DOTALL):
            exec(code, names)
    return names


def test_the_page_does_what_it_says(ran):
    """By the share that relaxes in half a minute, less what relaxed during the grip."""
    c = ran["TABLE_1"]["B"].c
    without = ran["without"]
    fall = 1.0 - without[-1] / without[0]
    assert 0.5 < fall < 1.0 - c[0]
    assert abs(ran["with_model"] / ran["GRIP"] - 1.0).max() < 0.03
    assert (ran["command"][1:] > ran["command"][:-1]).all()
    assert ran["low"] < ran["with_model"][-1] < ran["high"]
