"""Look at measurements before the first step and save the result; nothing is fitted."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from qlvbayes.io.data import Measurements, Pad
from qlvbayes.io.files import results_folder
from qlvbayes.motion.experiment import Experiment, prepare
from qlvbayes.motion.firstlook import FirstLook, look_at
from qlvbayes.motion.firstlook.shown import shown_between

LOOK = "look"


def look_into(
    folder: Path,
    study: Measurements,
    pads: Sequence[Pad],
    *,
    bonded: bool | None = None,
    effects: tuple[str, ...] = (),
    keep_all_readings: bool = False,
    files: Sequence[str] = (),
    next_commands: Sequence[str] = (),
) -> tuple[FirstLook, list[Path]]:
    """Look at some pads; leave ``look.json`` and a picture ``look_<pad>.png`` of each in a folder.

    bonded: whether specimens are fixed to the platen, by default where the file holds strain and
    stress; effects: those that the model has already; files: those that were read, by default the
    study's own; next_commands: commands to go on with. Returns the first look and the pictures'
    paths. Raises InputError where a test cannot be used or nothing can be written.
    """
    fixed = study.units.bonded_default if bonded is None else bonded
    experiments = [prepare(pad, keep_all_readings=keep_all_readings) for pad in pads]
    pads_seen = tuple(
        look_at(experiment, bonded=fixed, effects=effects) for experiment in experiments
    )
    look = FirstLook(
        source=tuple(files or (study.source,)),
        units=study.units,
        notices=study.notices,
        pads=pads_seen,
        between=shown_between(pads_seen, study.units),
        next=tuple(next_commands),
    )
    results_folder(folder)
    look.write(folder / f"{LOOK}.json")
    return look, [_picture(experiment, folder) for experiment in experiments]


def _picture(experiment: Experiment, folder: Path) -> Path:
    # imported here, so that reading does not wait for matplotlib
    from qlvbayes.plots.files import save_figure
    from qlvbayes.plots.look import plot_look

    return save_figure(plot_look(experiment), folder / f"{LOOK}_{experiment.pad}", ("png",))
