"""Draw a conversion of machine files: displacement, force, and first contact."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from qlvbayes.io.conversion import Conversion, Tidied
from qlvbayes.plots.style import (
    BLACK,
    DOUBLE,
    canvas,
    colours,
    displacement_label,
    force_label,
    narrow,
    shortened,
    style,
)

_PANEL = 36.0  # mm, height of a row of panels
_FRAME = 10.0  # mm, above the panels
_MOST = 8  # tests that are drawn; the others are counted in the title
_SHOWN = 3000  # samples of a curve; more are not visible
_NEAR = 0.3  # share of the peak force up to which the rise at contact is shown
_WIDE = 1.645  # standard errors on either side that hold 90 %


def plot_conversion(conversion: Conversion, *, width: float = DOUBLE) -> list[Axes]:
    """Draw displacement and force against time, and the force's rise at contact, test by test.

    ``conversion`` is that of machine files, ``width`` in mm; returns three panels for each test. A
    band shows first contact with its 90 % interval, where there is an approach.
    """
    tests = conversion.tests[:_MOST]
    tight = narrow(width)
    rows, columns = (3 * len(tests), 1) if tight else (len(tests), 3)
    with style():
        height = _FRAME + _PANEL * rows
        figure = canvas(width, height)
        axes = figure.subplots(rows, columns, squeeze=False).ravel()
        for k, test in enumerate(tests):
            _draw(list(axes[3 * k : 3 * k + 3]), test)
        left = len(conversion.tests) - len(tests)
        more = f"; {left} more tests are not drawn" if left else ""
        figure.suptitle(f"read from machine files{more}", x=0.01, ha="left")
    return list(axes)


def _draw(axes: Sequence[Axes], test: Tidied) -> None:
    over_time, force_over_time, rise = axes
    shown = slice(None, None, -(-len(test.time) // _SHOWN))
    first, second = colours()[:2]
    way = displacement_label(test.units)
    load = force_label(test.units)
    over_time.plot(test.time[shown], test.displacement[shown], color=first, gid="displacement")
    force_over_time.plot(test.time[shown], test.force[shown], color=second, gid="force")
    over_time.set_title(f"{shortened(test.pad, 20)}, {shortened(test.test)}", loc="left")
    for axis, label in ((over_time, way), (force_over_time, load)):
        axis.set(xlabel="time (s)", ylabel=label)
    peak = int(np.argmax(test.force >= _NEAR * test.force.max()))
    near = slice(0, max(peak + 1, 2))
    rise.plot(
        test.displacement[near], test.force[near], ".", markersize=2, color=second, gid="rise"
    )
    rise.axvline(0.0, color=BLACK, linewidth=0.5, gid="zero")
    rise.set(xlabel=way, ylabel=load)
    if test.contact is not None:
        contact = test.contact.position - test.zero
        half = _WIDE * test.contact.sd
        rise.axvspan(
            contact - half, contact + half, color=first, alpha=0.25, linewidth=0, gid="contact"
        )
        rise.set_title("first contact, with its 90 % interval", loc="left")
