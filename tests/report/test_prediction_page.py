"""The worked example of the page on prediction does what the page says."""

import re
from pathlib import Path

import pytest

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
