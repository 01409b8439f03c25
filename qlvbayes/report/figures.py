"""Figures inside the page: pictures with what each shows in words, and curves for its zoom."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import inf
from pathlib import Path

import numpy as np
from PIL import Image

from qlvbayes.diagnosis.phrases import model_name
from qlvbayes.fitting.residuals import Curves, TestCurves
from qlvbayes.plots.catalogue import FIGURES
from qlvbayes.report.collect import PadResults, read_if_there

_DPI, _CSS_DPI = 200, 96
_MM = 25.4 / _CSS_DPI  # mm, a pixel of the page
_WIDEST = 180.0  # mm, of a figure as wide as the page
_COLOURS = 128
_WHITE = 249
MOST_BYTES = 3_600_000  # of all pictures as text, so that the page stays under 5 MB


@dataclass(frozen=True)
class Picture:
    """A picture as a data URI with its size on the page (px); without one, where it lies."""

    alt: str
    see: str
    source: str | None
    width: int
    height: int
    path: str

    @property
    def share(self) -> float:
        """Width over that of a figure as wide as the page."""
        return round(self.width * _MM / _WIDEST, 3)


class Embedder:
    """Embedding of pictures into the page, as far as the limit of its size allows."""

    def __init__(self, out: Path, most: int = MOST_BYTES) -> None:
        self._out = out
        self._left = most

    def __call__(self, folder: Path, name: str, of: str = "") -> Picture | None:
        """Return the figure ``name``.png of a folder; None where it was not drawn."""
        path = folder / f"{name}.png"
        if not path.exists():
            return None
        width, height, content = _small(path)
        text = base64.b64encode(content).decode()
        kept = len(text) <= self._left
        if kept:
            self._left -= len(text)
        entry = next(one for one in FIGURES if one.name == name)
        source = f"data:image/png;base64,{text}" if kept else None
        where = str(path.relative_to(self._out))
        return Picture(entry.shows.format(of=of), entry.see, source, width, height, where)


def _small(path: Path) -> tuple[int, int, bytes]:
    """Return the size on the page (px) of a picture, and the picture in few colours."""
    with Image.open(path) as picture:
        width, height = (round(side * _CSS_DPI / _DPI) for side in picture.size)
        small = picture.convert("RGB").quantize(
            _COLOURS, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE
        )
    palette = np.array(small.getpalette()).reshape(-1, 3)
    palette[(palette >= _WHITE).all(axis=1)] = 255  # the mean of white and next to white
    small.putpalette(palette.ravel().tolist())
    content = io.BytesIO()
    small.save(content, "png")
    return width, height, content.getvalue()


_MOST = 3000  # samples of a test
_BAND = 1.645  # sds on either side that hold 90 % of normal noise


def chart_of(pad: PadResults) -> dict | None:
    """Return the curves that the script draws for one pad; None where there are none."""
    curves = read_if_there(Curves, pad.folder / "curves.json")
    if curves is None or not curves.tests:
        return None
    check, plain = pad.final.check, pad.baseline
    other = None
    if plain and plain.effects != pad.final.effects:
        other = read_if_there(Curves, plain.folder / "curves.json")
    before = {test.test: test for test in other.tests} if other else {}
    # the slowest first, as in the figures; tests without a rate are last
    tests = sorted(curves.tests, key=lambda test: inf if test.rate is None else test.rate)
    limits = {(c.test, c.phase): c.limit for c in check.cells} if check else {}
    names = [test.test for test in tests]
    # the test that is shown first: where a model fails worst, else the fastest
    checks = [model.check for model in (pad.final, plain) if model and model.check]
    worst = [c.worst.test for c in checks if c.worst and c.worst.test in names]
    drawn = []
    for test in tests:
        # half the width of the band of noise: it holds 90 % of the readings, or where noise that
        # moves a whole phase may do more, all that does not count as failing there
        own = [limits.get((test.test, kind)) or 0.0 for kind in test.phase]
        floor = [max(_BAND * curves.noise, limit) for limit in own]
        drawn.append(_test(test, before.get(test.test), floor) | {"speed": pad.speed_unit})
    return {
        "unit": curves.force_unit, "name": curves.force_name,
        "model": model_name(pad.final.effects),
        "first": names.index(worst[0]) if worst else len(names) - 1, "tests": drawn,
    }  # fmt: skip


def _test(test: TestCurves, before: TestCurves | None, floor: list[float]) -> dict:
    rows = list(_rows(test.phase))
    baseline = before.mean if before and before.time == test.time else None
    columns = {"t": test.time, "floor": floor}
    columns |= {name: getattr(test, name) for name in ("observed", "mean", "low", "high")}
    return {
        "name": test.test,
        "rate": None if test.rate is None else float(f"{test.rate:.3g}"),
        "fitted": test.role == "fit",
        "phases": [[p.kind, p.start, p.stop] for p in test.phases],
        **{name: [values[k] for k in rows] for name, values in columns.items()},
        "plain": None if baseline is None else [baseline[k] for k in rows],
        "left_out": [[one.time, one.force] for one in test.left_out],
    }


def _rows(phase: Sequence[str]) -> Iterator[int]:
    """Yield every sample, or evenly spaced ones, with the first and last of every phase."""
    step = -(-len(phase) // _MOST)
    for k in range(len(phase)):
        edge = k in (0, len(phase) - 1) or phase[k] != phase[k - 1] or phase[k] != phase[k + 1]
        if edge or k % step == 0:
            yield k
