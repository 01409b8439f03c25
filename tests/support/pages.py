"""Find what stands on a figure's page, and whether it can be read."""

from itertools import combinations

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text

MM = 1.0 / 25.4


def drawn(figure):
    """The figure's renderer, after it has been drawn once."""
    if not isinstance(figure.canvas, FigureCanvasAgg):
        FigureCanvasAgg(figure).draw()
    return figure.canvas.get_renderer()


def _unseen(figure):
    """Labels of ticks that lie outside their axis, or of axes that are off."""
    found = set()
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            low, high = sorted(axis.get_view_interval())
            for tick in (*axis.get_major_ticks(), *axis.get_minor_ticks()):
                if not axes.axison or not low <= tick.get_loc() <= high:
                    found |= {tick.label1, tick.label2}
            if not axes.axison:
                found.add(axis.label)
    return found


def texts(figure):
    """Every text that can be read."""
    unseen = _unseen(figure)
    return [
        t
        for t in figure.findobj(Text)
        if t.get_visible() and t.get_text().strip() and t not in unseen
    ]


def collisions(figure, slack=1.5):
    """Pairs of texts that run into each other by more than so many pixels."""
    renderer = drawn(figure)
    boxes = [(t.get_text(), t.get_window_extent(renderer).padded(-slack)) for t in texts(figure)]
    return [(a, b) for (a, one), (b, other) in combinations(boxes, 2) if one.overlaps(other)]


def keeps_the_page(figure, width):
    """Return whether the figure is so many mm wide and nothing leaves it."""
    ink = figure.get_tightbbox(drawn(figure)).extents
    page = figure.bbox_inches.extents
    inside = np.all(ink[:2] >= page[:2]) and np.all(ink[2:] <= page[2:])
    return bool(inside) and abs(figure.get_figwidth() - width * MM) < 1e-9


def lines(axis, name):
    """Lines with that mark of their kind."""
    return [line for line in axis.lines if line.get_gid() == name]


def points(axis, name):
    """Places (n, 2) of all lines with that mark."""
    return np.concatenate([line.get_xydata() for line in lines(axis, name)])
