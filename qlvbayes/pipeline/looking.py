"""Look at measurements before the first step, and save the result if asked; nothing is fitted."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from qlvbayes.io.data import Measurements, Pad
from qlvbayes.io.files import results_folder, write_whole
from qlvbayes.motion.experiment import Experiment, prepare
from qlvbayes.report.firstlook import FirstLook, PadSeen, look_at
from qlvbayes.report.firstlook.shown import shown_between

LOOK = "look"
Seen = tuple[PadSeen, bytes | None]
"""First look at a pad, and its picture as a PNG file, where one is drawn."""
Apply = Callable[[Callable[[Pad], Seen], Sequence[Pad]], Iterable[Seen]]
"""Function that applies a task to pads, in order, as ``map`` does."""


def look_into(
    folder: Path | None,
    study: Measurements,
    pads: Sequence[Pad],
    *,
    prepared: Callable[[Pad], Experiment] = prepare,
    bonded: bool | None = None,
    effects: tuple[str, ...] = (),
    files: Sequence[str] = (),
    next_commands: Sequence[str] = (),
    apply: Apply = map,
) -> tuple[FirstLook, list[Path]]:
    """Look at some pads; leave ``look.json`` and a ``look_<pad>.png`` of each in the folder."""
    fixed = study.units.bonded_default if bonded is None else bonded
    task = partial(_look_at, prepared, fixed, effects, folder is not None)
    results = list(apply(task, pads))
    pads_seen = tuple(seen for seen, _ in results)
    look = FirstLook(
        source=tuple(files or (study.source,)), units=study.units, notices=study.notices,
        pads=pads_seen, between=shown_between(pads_seen, study.units), next=tuple(next_commands),
    )  # fmt: skip
    if folder is None:
        return look, []
    results_folder(folder)
    look.write(folder / f"{LOOK}.json")
    figures = [folder / f"{LOOK}_{seen.pad}.png" for seen in pads_seen]
    for figure, (_, picture) in zip(figures, results, strict=True):
        write_whole(figure, picture or b"")
    return look, figures


def _look_at(
    prepared: Callable[[Pad], Experiment],
    bonded: bool,
    effects: tuple[str, ...],
    drawn: bool,
    pad: Pad,
) -> Seen:
    experiment = prepared(pad)
    seen = look_at(experiment, bonded=bonded, effects=effects)
    if not drawn:
        return seen, None
    # imported here, so that reading does not wait for matplotlib
    from qlvbayes.plots.files import save_figure
    from qlvbayes.plots.look import plot_look

    with TemporaryDirectory() as folder:
        picture = save_figure(plot_look(experiment), Path(folder) / LOOK, ("png",))
        return seen, picture.read_bytes()
