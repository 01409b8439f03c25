"""Plan the next tests of a pad from its saved fit or diagnosis."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from qlvbayes.diagnosis.nexttest.design import as_csv
from qlvbayes.diagnosis.nexttest.knowledge import CAUSE, read_knowledge
from qlvbayes.diagnosis.nexttest.result import NextTests
from qlvbayes.diagnosis.nexttest.series import Goal, plan_series
from qlvbayes.diagnosis.nexttest.summary import summarize
from qlvbayes.io.checks import InputError
from qlvbayes.io.files import write_whole
from qlvbayes.io.runtime import one_blas_thread
from qlvbayes.pipeline.steps import Watcher


def design_into(
    out: Path,
    pad: str,
    goals: Sequence[str],
    *,
    minutes: float,
    tests: int,
    depth: float | None = None,
    speed: float | None = None,
    acceleration: float | None = None,
    data: Path | None = None,
    seed: int = 0,
    watcher: Watcher | None = None,
) -> tuple[NextTests, Path]:
    """Plan the next tests; return them and the path of their figure.

    Leaves design.json, set_points.csv and the figure in ``out/pad``.
    """
    if not minutes > 0.0:
        raise InputError(f"--minutes is {minutes:g}", remedy="give it above 0")
    # imported here, so that other commands do not wait for matplotlib
    from qlvbayes.plots.files import save_figure
    from qlvbayes.plots.next_tests import plot_next_tests

    folder = out / pad
    with (watcher or Watcher()).doing(f"pad {pad}") as report, one_blas_thread():
        report("what is known")
        knowledge, cause = read_knowledge(folder, out, goals, data)
        names = tuple(name for name in goals if name != CAUSE)
        knowledge.belief.check(names)
        if not goals:
            names = knowledge.belief.base_names
        goal = Goal(names, cause)
        rig = knowledge.rig.limited(depth, speed, acceleration)
        errors = knowledge.errors(rig)
        series = plan_series(
            knowledge.belief, rig, errors, goal,
            minutes=minutes, tests=tests, clock=knowledge.clock, seed=seed, report=report,
        )  # fmt: skip
        result = summarize(
            pad, knowledge.units, knowledge.belief, rig, errors, goal, series,
            minutes=minutes, seed=seed,
        )  # fmt: skip
        report("writing")
        designs = [one.design for one in series.tests]
        write_whole(folder / "set_points.csv", as_csv(designs, knowledge.units).encode())
        result.write(folder / "design.json")
        axes = plot_next_tests(
            result, designs, knowledge.belief, rig, knowledge.floor.total, clock=knowledge.clock
        )
        figure = save_figure(axes, folder / "design")
    return result, figure
