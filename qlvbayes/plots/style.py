"""Set the look of figures: widths of a journal's columns, type, colours, a user's settings."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from contextvars import ContextVar
from functools import cache
from pathlib import Path
from typing import Any

import matplotlib
from cycler import cycler
from matplotlib import font_manager
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from qlvbayes.io.checks import InputError
from qlvbayes.io.units import UnitSystem
from qlvbayes.io.wording import literal

MM = 1.0 / 25.4  # inches
SINGLE, MIDDLE, DOUBLE = 85.0, 120.0, 180.0  # mm, one, one and a half and two columns
_NARROW = 110.0  # mm, up to which a figure is laid out for one column

# Okabe and Ito, distinguishable by colour-blind readers.
BLACK = "#000000"
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
PLAIN = COLOURS[4]  # of the model without effects, which differs from the first in grey too
LINES: Any = ("-", "--", ":", "-.")  # one for each colour, so that a grey copy can be read
MARKERS = ("o", "s", "^", "D", "v", "P")

STYLE: dict[Any, Any] = {
    # the signs that figures use, from which a PDF's letters are cut quickly; others from the whole
    "font.family": ["qlvbayes Sans", "DejaVu Sans"],
    "font.size": 7.5,
    "axes.titlesize": 7.5,
    "axes.labelsize": 7.0,
    "xtick.labelsize": 7.0,
    "ytick.labelsize": 7.0,
    "legend.fontsize": 7.5,
    "figure.titlesize": 8.5,
    "figure.titleweight": "bold",
    "figure.labelsize": 7.0,  # notes under a figure
    "figure.facecolor": "white",
    "axes.prop_cycle": cycler(color=COLOURS),
    "axes.linewidth": 0.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.major.width": 0.5,
    "ytick.major.width": 0.5,
    "xtick.minor.width": 0.3,
    "ytick.minor.width": 0.3,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "xtick.minor.size": 1.5,
    "ytick.minor.size": 1.5,
    "lines.linewidth": 0.8,
    "legend.frameon": False,
    "hatch.linewidth": 0.4,
    "pdf.fonttype": 42,  # whole TrueType fonts: text stays text
    "svg.fonttype": "none",
    "savefig.dpi": 200,
}
# Settings of where a figure goes, and TeX, which would run what a test's name contains.
_NOT_LOOKS = {"backend", "backend_fallback", "interactive", "toolbar", "text.usetex"}
_own: ContextVar[dict[str, Any]] = ContextVar("own", default={})  # noqa: B039 (never changed)
_KEY = re.compile(r"[Kk]ey ([\w.]+):")


_matplotlib: Any = matplotlib  # the keys of its settings have too many types to declare


@cache
def _add_fonts() -> None:
    """Make the package's fonts known to Matplotlib."""
    for path in sorted((Path(__file__).parent / "fonts").glob("*.ttf")):
        font_manager.fontManager.addfont(path)


def style() -> AbstractContextManager[None]:
    """Return a context manager for ``STYLE`` and, over it, the settings of ``using``."""
    _add_fonts()
    return _matplotlib.rc_context({**STYLE, **_own.get()})


@contextmanager
def using(look: Mapping[str, Any] | str | Path) -> Iterator[None]:
    """Draw and save every figure within the ``with`` in a user's own look.

    The settings are applied over ``STYLE``; the colours of curves are those of ``axes.prop_cycle``.
    Uses may be nested, and the inner one wins.

    Parameters
    ----------
    look
        Settings of Matplotlib (``{"font.size": 9, "lines.linewidth": 1.2}``), a style file
        (``.mplstyle``), or the name of a style of Matplotlib (``"grayscale"``).

    Raises
    ------
    InputError
        The look cannot be used; the error names file and line.
    """
    token = _own.set({**_own.get(), **_settings(look)})
    try:
        yield
    finally:
        _own.reset(token)


def own_look() -> dict[str, Any]:
    """Return the settings of ``using`` now, which ``using`` accepts in another process."""
    return dict(_own.get())


def colours() -> tuple[str, ...]:
    """Return the colours of curves in the look in use, and ours after them up to six."""
    own = _matplotlib.rcParams["axes.prop_cycle"].by_key().get("color", [])
    names = (one if isinstance(one, str) else to_hex(one) for one in own)
    return (*names, *COLOURS[len(own) :])


def canvas(width: float, height: float, **layout: Any) -> Figure:
    """Return an empty figure of this width and height (mm)."""
    return Figure((width * MM, height * MM), **(layout or {"layout": "constrained"}))


def titled_legend(figure: Figure, title: str, *entries: Any, **look: Any) -> None:
    """Draw the legend, handles and labels, at the upper left under the figure's title."""
    fonts = {what: _matplotlib.rcParams[f"figure.title{what}"] for what in ("size", "weight")}
    look = {"loc": "outside upper left", "alignment": "left", **look}
    figure.legend(*entries, title=title, title_fontproperties=fonts, **look)


def name_rows(axis: Axes, names: Sequence[str], bold: Collection[int] = ()) -> None:
    """Name the rows of an axis from top to bottom, some in bold letters, without ticks."""
    axis.set_yticks(range(len(names)), names)
    for row, tick in enumerate(axis.get_yticklabels()):
        tick.set_fontweight("bold" if row in bold else "normal")
    axis.set_ylim(len(names) - 0.4, -0.6)
    axis.tick_params(axis="y", length=0)
    axis.spines["left"].set_visible(False)


def write_right(
    axis: Axes, text: str, row: float, points: float, *, up: float = 0.0, **look: Any
) -> None:
    """Write text at a row of the axes, this many points right of them and ``up`` points higher."""
    position = {"xycoords": axis.get_yaxis_transform(), "va": "center", **look}
    axis.annotate(
        text, (1.0, row), xytext=(points, up), textcoords="offset points", annotation_clip=False,
        **position,
    )  # fmt: skip


def narrow(width: float) -> bool:
    """Return whether a figure of this width (mm) is laid out for one column."""
    return width < _NARROW


def _settings(look: Mapping[str, Any] | str | Path) -> dict[str, Any]:
    if isinstance(look, Mapping):
        try:
            settings: dict[str, Any] = dict(_matplotlib.RcParams(dict(look)))
        except (KeyError, ValueError) as error:
            raise InputError(f"not settings of Matplotlib ({_first_line(error)})") from error
    else:
        from matplotlib import style as styles  # reads all of Matplotlib's styles

        library: Any = styles.library
        named = str(look) in library and not Path(look).exists()
        settings = dict(library[str(look)]) if named else _from_file(Path(look))
    return {key: value for key, value in settings.items() if key not in _NOT_LOOKS}


def _from_file(file: Path) -> dict[str, Any]:
    try:
        lines = file.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        remedy = "name a Matplotlib style file (.mplstyle)"
        raise InputError("this style cannot be read", file=file, remedy=remedy) from error
    keys = dict(_keys(file, lines))
    try:
        return dict(_matplotlib.rc_params_from_file(file, True, use_default_template=False))
    except Exception as error:  # each setting has a check of its own, with its own errors
        text = _first_line(error)
        match = _KEY.match(text)
        line = keys.get(match[1]) if match else None
        raise InputError(
            f"not a style ({text})", file=file, line=line, remedy="correct the value"
        ) from error


def _keys(file: Path, lines: list[str]) -> Iterator[tuple[str, int]]:
    """Yield each setting with its line."""
    for number, line in enumerate(lines, 1):
        text = line.strip()
        if not text or text.startswith("#"):
            continue
        key, colon, _ = text.partition(":")
        if not colon:
            remedy = "write 'setting: value'"
            raise InputError("no colon in this line", file=file, line=number, remedy=remedy)
        if key.strip() not in matplotlib.rcParams:
            raise InputError(
                f"Matplotlib has no setting '{key.strip()[:60]}'",
                file=file,
                line=number,
                remedy="see 'matplotlibrc' in its documentation",
            )
        yield key.strip(), number


def _first_line(error: Exception) -> str:
    return str(error).strip("'\"").partition("\n")[0]


def quantity(name: str, unit: str) -> str:
    """Return the label of an axis: 'force (N)', or the name alone where the unit is 1."""
    return name if unit == "1" else f"{name} ({unit})"


def force_label(units: UnitSystem) -> str:
    """Return the label of a force axis: 'force (N)'."""
    return quantity(units.force_name, units.force)


def displacement_label(units: UnitSystem) -> str:
    """Return the label of a displacement axis: 'displacement (mm)'."""
    return quantity(units.displacement_name, units.displacement)


def percentage(probability: float) -> str:
    """Return a probability in tenths of a per cent; it is never written as certain."""
    percent = 100.0 * probability
    if percent < 0.1:
        return "< 0.1 %"
    return "> 99.9 %" if percent > 99.9 else f"{percent:.1f} %"


def shortened(name: str, most: int = 40) -> str:
    """Return a name from a file, cut to fit on the page, and never read as a formula."""
    text = literal(name if len(name) <= most else f"{name[: most - 1]}…")
    return f" {text}" if text.startswith("_") else text
