"""``qlvbayes design``: which test to do next."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

from rich.table import Table

from qlvbayes.cli.console import out, table
from qlvbayes.cli.options import known_names, positive_values, split_names
from qlvbayes.io.checks import InputError, check_known
from qlvbayes.io.wording import plain

if TYPE_CHECKING:
    from qlvbayes.diagnosis.nexttest.planning import NextTests

_LIMITS = ("depth", "speed", "acceleration")
_FILES = ("posterior.nc", "diagnosis.json")


def design(
    folder: Path,
    pads: str = "",
    wanted: str = "",
    minutes: float = 10.0,
    tests: int = 3,
    limits: str = "",
    data: Path | None = None,
    seed: int = 0,
    as_json: bool = False,
) -> None:
    """Propose the most informative tests, and write their set-points.

    For constants, the information per minute of rig time counts; for the cause, that in all the
    time there is. About a thousand tests within the rig's limits are compared by the information
    that they are expected to give.
    Leaves OUT/<pad>/design.json, set_points.csv (1 000 a second, for the rig and for 'check
    --program') and the figure design.

    Options:
    folder FOLDER: The folder that 'study' or 'fit' wrote.
    wanted --for: Constants to be known better, as 'm,b'; 'cause' to distinguish the explanations
        that the diagnosis left; or both. Default: all that is not known.
    minutes: Of rig time, pauses too, at most.
    tests 1..5: At most.
    limits: Of the rig, in the file's units, as 'depth=2,speed=50,acceleration=1000'. Default: as
        tested.
    """
    # imported here, so that the help does not wait for them
    from qlvbayes.cli.terminal import Terminal, show_figures
    from qlvbayes.pipeline.designing import design_into

    watcher = Terminal(quiet=as_json)
    results, figures = [], []
    known = sorted({path.parent.name for name in _FILES for path in folder.glob(f"*/{name}")})
    if not known:
        raise InputError("no results in this folder", file=folder, remedy="run qlvbayes study")
    for name in known_names(pads, known, folder, "results") or known:
        result, figure = design_into(
            folder, name, split_names(wanted), minutes=minutes, tests=tests, data=data,
            seed=seed, watcher=watcher, **_limits(limits),
        )  # fmt: skip
        figures.append(figure)
        results.append(result)
        watcher.notice(*(f"pad {name}: {notice}" for notice in result.notices))
    if as_json:
        print(json.dumps([one.as_dict() for one in results], allow_nan=False))
        return
    for one in results:
        out.print(_tests(one))
        if one.widths:
            out.print(_widths(one))
    show_figures(figures)


def _limits(text: str) -> dict[str, float]:
    """Return the rig's limits in ``depth=2,speed=50``."""
    found: dict[str, float] = {}
    for part in split_names(text):
        name, _, value = (word.strip() for word in part.partition("="))
        check_known("limit", name, _LIMITS)
        (found[name],) = positive_values(f"--limits {name}", value or "0", "2")
    return found


def _tests(plan: NextTests) -> Table:
    """Return a table with a row for each test, and one for all."""
    doubt = ", ".join(f"{name} ({share:.0%})" for name, share in plan.causes.items())
    caption = f"{plan.entropy:.2f} bits are missing to distinguish {doubt}" if plan.cause else None
    columns = ["test", ">minutes"]
    columns += [">bits, constants"] if plan.constants else []
    columns += [">bits, cause"] if plan.cause else []
    columns += [">bits a minute", "what the platen does"]
    made = table(f"pad {plan.pad}: the next tests", *columns, caption=caption)
    for one in plan.tests:
        cells = [one.name, f"{one.minutes:.2f}"]
        cells += [f"{one.constants:.2f}"] if plan.constants else []
        cells += [f"{one.judged.cause:.2f}"] if plan.cause else []
        made.add_row(*cells, f"{one.per_minute:.2f}", one.words)
    minutes, all_bits = sum(one.minutes for one in plan.tests), plan.together
    cells = ["all", f"{minutes:.2f}"]
    if plan.constants:
        cells += [f"{all_bits.constants:.2f} ± {all_bits.constants_error:.2f}"]
    cells += [f"{all_bits.cause:.2f} ± {all_bits.cause_error:.2f}"] if plan.cause else []
    total = all_bits.constants * bool(plan.constants) + all_bits.cause * plan.cause
    made.add_row(*cells, f"{total / minutes:.2f}", "", end_section=True)
    return made


def _widths(plan: NextTests) -> Table:
    """Return a table of the constants' standard deviations now and after all tests."""
    made = table(plan.hypotheses[0].words, "constant", ">value", ">sd now", ">sd expected")
    for name, one in plan.widths.items():
        unit = "" if one.unit == "1" else f" {one.unit}"
        made.add_row(name, f"{plain(one.mean)}{unit}", plain(one.now, 2), plain(one.after, 2))
    return made
