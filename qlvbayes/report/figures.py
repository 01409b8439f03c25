"""Figures inside the page: what each shows, in words, and its picture, made small."""

from __future__ import annotations

import base64
import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

_DPI, _CSS_DPI = 200, 96
_COLOURS = 128
_WHITE = 249
MOST_BYTES = 3_600_000  # of all pictures as text, so that the page stays under 5 MB

# What it is (for those who cannot see it too), and what to see in it.
_SAID = {
    "programme": (
        "Displacement against time of every test of {of}.",
        "How the pad was pressed: steeper is faster, level is held.",
    ),
    "constants": (
        "Every constant of all pads with its 90 % interval.",
        "Where the intervals of two pads do not overlap, the pads differ in that constant. Open "
        "diamonds are reference values, where some are known.",
    ),
    "pairs": (
        "Joint posterior of the constants of {of}, two at a time.",
        "A slanted cloud: only a combination of the two constants is known well.",
    ),
    "forces_at_rates": (
        "Force against time at slow, middle and fast loading, measured and predicted.",
        "Dots inside the band are predicted to within the noise.",
    ),
    "contrasts": (
        "Ratios of {of} with 90 % intervals against the region of practical equivalence.",
        "Inside the shaded region: equal for practical purposes. Clear of the line at 1 and not "
        "inside: different. On both sides of the line and beyond the region: undecided.",
    ),
    "forces": (
        "Force against time of every test of {of}, by phase, measured and predicted.",
        "Dots are measured, the line is the model, the band holds 90 % of predicted samples. Dots "
        "that leave the band in a row are where the model fails.",
    ),
    "hysteresis": (
        "Force against displacement of every test of {of}, measured and predicted.",
        "The area between loading and unloading is the energy lost. Where the loops of dots and "
        "line differ, the model loses too much or too little.",
    ),
    "residual_map": (
        "Prediction error over noise floor of {of}, by test and phase.",
        "1 is noise; in marked cells the error is more than noise.",
    ),
    "residuals_before_after": (
        "Error over noise floor of {of} by test and phase, for the plain model and for the last.",
        "Cells near 1 are noise. What is dark on the left and light on the right was explained by "
        "what was added.",
    ),
    "forces_before_after": (
        "Residuals of {of} against time before and after the effects were added.",
        "Does the error stay in the hold or end with the motion? Does it grow with speed, with "
        "depth, with time?",
    ),
    "evidence": (
        "Evidence for each hypothesis about what {of} lacks.",
        "A bar to the right: the tests are better explained with this effect in the model than "
        "without it; to the left: worse. The axis is logarithmic where bars differ much.",
    ),
    "prediction": (
        "What {of} is predicted to do in a programme of the user's own.",
        "Above what is prescribed, beneath the answer: the bands hold 50 and 90 % of the draws.",
    ),
    "error_staircase": (
        "Error of {of} after each step, fitted and on tests left out, against the noise floor.",
        "Each step down is an effect that was added; at the noise nothing is left to explain.",
    ),
}


@dataclass(frozen=True)
class Figure:
    """A picture as a data URI with its size on the page (px); without one, where it lies."""

    alt: str
    see: str
    source: str | None
    width: int
    height: int
    path: str


class Embedder:
    """Embedding of pictures into the page, as far as the limit of its size allows."""

    def __init__(self, out: Path, most: int = MOST_BYTES) -> None:
        self._out = out
        self._left = most

    def __call__(self, folder: Path, name: str, of: str = "") -> Figure | None:
        """Return the figure ``name``.png of a folder; None where it was not drawn."""
        path = folder / f"{name}.png"
        if not path.exists():
            return None
        width, height, content = _small(path)
        text = base64.b64encode(content).decode()
        kept = len(text) <= self._left
        if kept:
            self._left -= len(text)
        alt, see = _SAID[name]
        return Figure(
            alt=alt.format(of=of),
            see=see,
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
