"""The class of all commands: settings as options, one style of figures, and its help."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from typer.core import TyperCommand

from qlvbayes.cli.settings import FILE, expanded, help_lines

STYLE = "--style FILE: a Matplotlib style file (.mplstyle) for the figures, over the package's own."


class Command(TyperCommand):
    """Command whose settings may be given as options, and whose figures take a style."""

    def __init__(self, *words: Any, **options: Any) -> None:
        if lines := help_lines(str(options.get("name"))):
            head = f"Settings, in {FILE} or as options:"
            options["epilog"] = "\n\n".join((head, *lines, STYLE))
        super().__init__(*words, **options)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the words of the command line."""
        return super().parse_args(ctx, expanded(self.name or "", self._without_style(ctx, args)))

    def _without_style(self, ctx: Any, args: list[str]) -> list[str]:
        """Draw all figures of the command in the style that ``--style`` names."""
        left = list(args)
        for place, word in enumerate(args):
            name, equals, file = word.partition("=")
            if name != "--style" or (not equals and place + 1 == len(args)):
                continue
            file = file if equals else args[place + 1]
            del left[place : place + (1 if equals else 2)]
            # imported here, so that commands do not wait for matplotlib
            from qlvbayes.plots.style import using

            ctx.with_resource(using(Path(file)))
            break
        return left
