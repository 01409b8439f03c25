"""The tests that a pad was fitted to, where their file is at hand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from qlvbayes.io.checks import InputError
from qlvbayes.io.data import Measurements, Pad, read_measurements
from qlvbayes.motion.experiment import Experiment, prepare
from qlvbayes.use.exports.pad import ExportedPad


def own_tests(pad: ExportedPad) -> tuple[Experiment | None, str]:
    """Return all tests of a pad as the fit saw them; else None, and why.

    Raises InputError where the user names a file that is not that of the fit.
    """
    if pad.data is None:
        if not pad.source:
            return None, "the results do not say which file was fitted"
        if not Path(pad.source).is_file():
            return None, f"{pad.source} is not there; --data FILE says where the tests are"
    study = read_measurements(pad.data or pad.source)
    if study.sha256 != pad.sha256:
        if pad.data is None:
            return None, f"{pad.source} has changed since the fit"
        raise InputError(
            f"not the file that pad {pad.name} was fitted to", file=pad.data, remedy="fit it again"
        )
    choices = pad.choices
    tests = prepare(
        _pad_of(study, pad.name),
        all_tests=pad.all_tests,
        keep_all_readings=choices.keep_all_readings,
        use=choices.use,
    )
    return replace(tests, rested=choices.rested), ""


def _pad_of(study: Measurements, name: str) -> Pad:
    """Return the pad of that name, or the only one of its file, which is named after the file."""
    if len(study.pads) == 1:
        return study.pads[0]
    stem = Path(study.source).name.split(".")[0]
    known = {f"{stem}-{pad.name}": pad for pad in study.pads} | {x.name: x for x in study.pads}
    return known[name] if name in known else study.pad(name)
