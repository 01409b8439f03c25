"""Write figures to disk: whole or not at all, the same bytes for the same figure."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from qlvbayes.io.files import write_whole
from qlvbayes.plots.style import style

# Neither date nor program, so that a repeated run gives the same file.
_METADATA: dict[str, dict[str, Any]] = {
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
    "png": {"Software": None},
}
_NO_ENGINE: Any = {"figure.autolayout": False, "figure.constrained_layout.use": False}


def figure_of(drawn: Axes | Sequence[Axes] | Figure) -> Figure:
    """Return the figure that contains what a function of this package returned; a figure itself."""
    if isinstance(drawn, Figure):
        return drawn
    first = drawn if isinstance(drawn, Axes) else drawn[0]
    figure = first.get_figure(root=True)
    assert isinstance(figure, Figure)
    return figure


def save_figure(
    drawn: Axes | Sequence[Axes] | Figure, path: Path, kinds: Sequence[str] = tuple(_METADATA)
) -> Path:
    """Write ``path``.pdf (fonts embedded) and ``path``.png (200 dpi); return the latter.

    ``drawn`` is what a function of this package returned, or a figure; ``path`` has no suffix;
    ``kinds`` are both by default. Each file is written under a temporary name, then renamed.
    """
    figure = figure_of(drawn)
    with style(), warnings.catch_warnings(), _laid_out(figure):
        warnings.filterwarnings("ignore", "Glyph .* missing")  # a missing glyph is drawn as a box
        for suffix in kinds:
            _write(figure, path, suffix)
    return path.with_name(f"{path.name}.png")


@contextmanager
def _laid_out(figure: Figure) -> Iterator[None]:
    """Lay the figure out once, not for each file, which takes longer than the drawing.

    It is laid out in the resolution of the files: letters are some per cent wider in another.
    """
    engine, dpi = figure.get_layout_engine(), figure.get_dpi()
    figure.set_dpi(float(matplotlib.rcParams["savefig.dpi"]))
    if engine is not None:
        engine.execute(figure)
        with matplotlib.rc_context(_NO_ENGINE):
            figure.set_layout_engine(None)
    try:
        yield
    finally:
        if engine is not None:
            figure.set_layout_engine(engine)
        figure.set_dpi(dpi)


def _write(figure: Figure, path: Path, suffix: str) -> None:
    drawn = BytesIO()
    figure.savefig(drawn, format=suffix, metadata=_METADATA[suffix])
    write_whole(path.with_name(f"{path.name}.{suffix}"), drawn.getbuffer())
