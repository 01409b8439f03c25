"""Write to the terminal: progress on stderr where it is a terminal, tables on stdout."""

from __future__ import annotations

import sys
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table
from rich.text import Text

from qlvbayes.io.wording import as_typed, visible

if TYPE_CHECKING:  # importing the sampler takes longer than most commands run
    from qlvbayes.fitting.ensemble import Progress as Report

WIDE = 140  # characters per line of a table where the output is no terminal


class Plain(Console):
    """Console for plain text: no markup, and no control characters that reach the terminal."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(markup=False, emoji=False, highlight=False, **settings)

    def render_str(self, text: str, **settings: Any) -> Text:
        """Return text with control characters made visible; cells and titles of tables pass too."""
        return super().render_str(visible(text, keep="\n"), **settings)


out = Plain(width=None if sys.stdout.isatty() else WIDE)
err = Plain(stderr=True, width=None if sys.stderr.isatty() else 1000)


def table(title: str, *columns: str, whole: Collection[str] = (), **style: Any) -> Table:
    """Return an empty table; ``>name`` is a column of numbers, those of ``whole`` never wrap."""
    made = Table(title=title or None, title_justify="left", title_style="bold", **style)
    for name in columns:
        right = "right" if name.startswith(">") else "left"
        name = name.removeprefix(">")
        made.add_column(name, justify=right, no_wrap=name in whole, overflow="fold")  # type: ignore[arg-type]
    return made


def command_line() -> str:
    """Return the command line, quoted so that a shell takes it again."""
    return as_typed("qlvbayes", *sys.argv[1:])


@contextmanager
def counting(what: str, label: str = "") -> Iterator[Report]:
    """Show a progress bar of so many ``what``; stay silent where stderr is no terminal."""
    with Progress(
        TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn(),
        TextColumn(f"{what},"), TimeElapsedColumn(), TextColumn("gone,"), TimeRemainingColumn(),
        TextColumn("left"), console=err, transient=True, disable=not err.is_terminal,
    ) as bar:  # fmt: skip
        task = bar.add_task(visible(label), total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


@contextmanager
def waiting(label: str) -> Iterator[Callable[[str], None]]:
    """Show a spinner and yield a function that adds a word; silent where stderr is no terminal."""
    if not err.is_terminal:
        yield lambda text: None
        return
    with err.status(Text(visible(label))) as status:
        yield lambda text: status.update(Text(visible(f"{label}: {text}")))
