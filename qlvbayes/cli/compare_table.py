"""Table of a comparison for people."""

from __future__ import annotations

from rich.table import Table
from rich.text import Text

from qlvbayes.comparison.contrast import Comparison, Contrast
from qlvbayes.comparison.numbers import with_interval, written

_STYLES = {"greater": "bold", "less": "bold", "equal": "green", "cannot tell": "dim"}


def contrasts_table(found: Comparison) -> Table:
    """Medians of both, their ratio with its interval, the probabilities and the answer."""
    one, other = found.names
    title = (
        f"{one} against {other}: medians, ratio [90 % interval], region {100 * found.region:g} %"
    )
    table = Table(title=title, title_justify="left", title_style="bold")
    table.add_column("quantity", no_wrap=True)
    table.add_column("unit")
    for name in (one, other, f"{one}/{other}", "P(greater)", "P(equal)"):
        table.add_column(name, justify="right")
    table.add_column("answer", no_wrap=True)
    before = None
    for c in found.contrasts:
        if before not in (None, c.group):
            table.add_section()
        before = c.group
        table.add_row(*_cells(c))
    return table


def _cells(c: Contrast) -> list[str | Text]:
    return [
        c.quantity + (" *" if c.extrapolated else ""),
        "" if c.unit == "1" else c.unit,
        written(c.first)[0],
        written(c.second)[0],
        "" if c.ratio is None else with_interval(c.ratio),
        f"{c.direction:.3f}",
        f"{c.equivalence:.3f}",
        Text(c.answer, style=_STYLES[c.answer]),
    ]
