"""Figures inside the page: what each shows, in words, and its picture, made small."""

from __future__ import annotations

import base64
import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from qlvbayes.plots.catalogue import FIGURES

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
        return Picture(
            alt=entry.shows.format(of=of),
            see=entry.see,
            source=f"data:image/png;base64,{text}" if kept else None,
            width=width,
            height=height,
            path=str(path.relative_to(self._out)),
        )


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
