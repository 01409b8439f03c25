"""Draws what each listed effect adds to the force: python docs/building/effect_pictures.py [DIR].

One pad of the simulator is pressed twice, held and taken back to contact, as the second test of a
series, with each effect in it and without; its difference is drawn. The simulator integrates
differential equations and shares no code with the model.
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from qlvbayes.effects.catalogue import EFFECTS
from qlvbayes.plots.style import style
from qlvbayes.simulate import TABLE_1, HiddenPad, Platen, draw_effect_in, full_retraction_protocol

ROOT = Path(__file__).parents[2]
SIZE = 0.06  # of the peak force: the effect's largest contribution in these tests
RATES = (2.0, 20.0)  # mm/s, of the first test and the second; the second is drawn
APART = 600.0  # s between their beginnings, so that what changes with the clock has changed
PHASES = ("press", "hold", "back", "rest") * 2
COLUMNS = 4
GREY, BLUE = "0.55", "#0072b2"


def phases(platen: Platen) -> list[tuple[float, float]]:
    """Begin and end (s) of each press, hold and way back."""
    edges = [0.0]
    for piece, after in zip(platen.pieces[:-1], platen.pieces[1:], strict=True):
        still, then = (one.velocity == one.acceleration == 0.0 for one in (piece, after))
        if still != then:
            edges.append(after.start)
    return list(zip(edges, [*edges[1:], platen.duration], strict=True))


def draw(ax: Axes, pad: HiddenPad, effect: HiddenPad, platen: Platen) -> None:
    """Draw the force that the effect adds, in per cent of the peak, before the force itself."""
    spans, peak = phases(platen), 0.0
    curves = []
    for k, (begin, end) in enumerate(spans):
        even = np.linspace(0.0, 1.0, 240)
        # at rest the time since it began is drawn in its logarithm, from 1 ms
        moves = k % 2 == 0
        since = (end - begin) * even if moves else 1e-3 * ((end - begin) / 1e-3) ** even
        time = np.clip(begin + since, begin + 1e-9, end - 1e-9)
        plain, with_it = pad.force(platen, time), effect.force(platen, time)
        peak = max(peak, float(plain.max()))
        curves.append((k + even, plain, with_it - plain))
    most = max(float(np.abs(added).max()) for *_, added in curves)
    for x, plain, added in curves:
        ax.fill_between(x, 0.0, plain / peak * 100.0 * most / peak, color="0.9", lw=0)
        ax.plot(x, 100.0 * added / peak, color=BLUE, lw=1.2)
    for edge in range(1, len(spans)):
        ax.axvline(edge, color="0.8", lw=0.5, zorder=0)
    ax.axhline(0.0, color=GREY, lw=0.5, zorder=0)
    ax.set_xlim(0.0, len(spans))


def signatures() -> Figure:
    """A panel for each listed effect."""
    pad = HiddenPad(TABLE_1["B"])
    tests = [
        Platen(full_retraction_protocol(rate), start_s=k * APART, number=k)
        for k, rate in enumerate(RATES)
    ]
    lines = -(-len(EFFECTS) // COLUMNS)
    with style():
        figure = Figure((7.1, 1.25 * lines), layout="constrained")
        panels = figure.subplots(lines, COLUMNS, sharex=True).ravel()
        for ax, kind in zip(panels, EFFECTS, strict=False):
            rng = np.random.default_rng(1)
            effect = draw_effect_in(kind.name, rng, pad, tests, SIZE, TABLE_1["B"].v)
            draw(ax, pad, HiddenPad(TABLE_1["B"], (effect,)), tests[-1])
            ax.set_title(kind.name, fontsize=7, loc="left", fontweight="bold")
            ax.tick_params(labelsize=6)
            ax.set_xticks([k + 0.5 for k in range(len(PHASES))], PHASES, fontsize=5, rotation=90)
            ax.tick_params(axis="x", length=0)
        for ax in panels[len(EFFECTS) - COLUMNS : len(EFFECTS)]:
            ax.tick_params(labelbottom=True)
        for ax in panels[len(EFFECTS) :]:
            ax.remove()
        figure.supylabel("force added (% of the peak force)", fontsize=7)
    return figure


def main() -> None:
    """The one picture."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs" / "pictures"
    signatures().savefig(folder / "effects.png", dpi=200)
    print(folder / "effects.png")


if __name__ == "__main__":
    main()
