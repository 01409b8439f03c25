"""Combine the parts of a divided run: tables, comparison and report of the finished pads."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

from msgspec import convert

from qlvbayes.fitting.ensemble import Settings
from qlvbayes.fitting.results import Saved, load
from qlvbayes.fitting.runs import Run
from qlvbayes.io.checks import InputError
from qlvbayes.io.data import Measurements, read_measurements
from qlvbayes.model.choices import Choices
from qlvbayes.parallel.engines import Engine
from qlvbayes.parallel.faults import Fault, fault_of
from qlvbayes.pipeline.comparing import fitted_pads
from qlvbayes.pipeline.drawing import find_references
from qlvbayes.pipeline.finished import faults_in
from qlvbayes.pipeline.many import Tally
from qlvbayes.pipeline.run import anything_named, finish, run_finals, verdict, with_verdict
from qlvbayes.pipeline.source import pad_of
from qlvbayes.pipeline.watcher import Watcher
from qlvbayes.report.collect import facts_of, runs_in


def gather(
    out: Path,
    *,
    references: Path | None = None,
    engine: Engine | None = None,
    watcher: Watcher | None = None,
) -> Tally:
    """Write what an undivided run writes of all its pads; return the pads and the faults."""
    watcher = watcher or Watcher()
    run = runs_in(out)
    late: tuple[Fault, ...] = ()
    if "study" in run:
        late = _finals(out, run["study"], engine, watcher).faults
    pads = fitted_pads(out)
    seed = max((one.seed for one in run.values()), default=0)
    finish(out, pads, find_references(_data_folder(out, pads), references), seed, watcher, engine)
    faults = {fault.of: fault for fault in (*faults_in(out), *late)}
    return Tally(tuple(pads), tuple(faults.values()))


def _data_folder(out: Path, pads: list[str]) -> Path:
    return Path(load(out / pads[0] / "posterior.nc").source).parent


def _finals(out: Path, run: Run, engine: Engine | None, watcher: Watcher) -> Tally:
    """Run the final fits that the diagnosed pads of a study lack."""
    pads = [file.parents[1].name for file in sorted(out.glob("*/plain/check.json"))]
    pads = [pad for pad in pads if (out / pad / "diagnosis.json").exists()]
    named = anything_named(out, pads, Choices.from_dict(run.choices))
    missing = [pad for pad in pads if not _is_final(out / pad, named=named)]
    return run_finals(
        out,
        _studies(out, missing),
        lambda study: _choices(facts_of(out / study.pads[0].name / "plain" / "posterior.nc")),
        convert(run.settings["sampler"], Settings),
        named=named,
        size=len(missing),
        engine=engine,
        watcher=watcher,
    )


def _is_final(folder: Path, *, named: bool) -> bool:
    """Return whether the pad's saved fit is the final one that all verdicts require."""
    if not (folder / "check.json").exists():
        return False
    last, baseline = (facts_of(folder / part / "posterior.nc") for part in ("", "plain"))
    expected = _choices(baseline)
    if named:
        expected = with_verdict(expected, verdict(folder.parent, folder.name))
    return bool(last) and (_choices(last), bool(last["all_tests"])) == (expected, named)


def _choices(facts: dict) -> Choices:
    return Choices.from_dict(json.loads(facts["choices"]))


def _studies(out: Path, pads: list[str]) -> Iterator[Measurements | Fault]:
    """Yield the measurements of some pads, read from where their fits say that they are."""
    reader = Reader()
    for pad in pads:
        try:
            yield reader.study(load(out / pad / "plain" / "posterior.nc"))
        except Exception as error:  # one missing file must not stop the others
            fault = fault_of(error)
            yield Fault(fault.text, fault.mendable, f"pad {pad}")


class Reader:
    """Reader of the measurements of saved fits.

    The last file is kept, as the next pad is often in it.

    data: file or folder of the measurements, if they have moved since the fits.
    """

    def __init__(self, data: Path | None = None) -> None:
        self._data = data
        self._source: Path | None = None
        self._study: Measurements | None = None

    def study(self, saved: Saved) -> Measurements:
        """Return the study of one pad; raise InputError where its file is gone or changed."""
        source = Path(saved.source)
        if self._data is not None:
            source = self._data / source.name if self._data.is_dir() else self._data
        if self._study is None or source != self._source:
            self._study, self._source = self._read(source, saved), source
        if saved.sha256 and self._study.sha256 != saved.sha256:
            raise InputError(
                "the file has changed since the fit", file=source, remedy="run qlvbayes fit again"
            )
        return pad_of(self._study, saved.pad)

    def _read(self, source: Path, saved: Saved) -> Measurements:
        if not saved.source and source == Path():
            raise InputError(
                f"the posterior of pad {saved.pad} does not say where its measurements are",
                remedy="say where they are with --data FILE",
            )
        if not source.exists():
            raise InputError(
                "the measurements are no longer here",
                file=source,
                remedy="say where they are with --data FILE",
            )
        return read_measurements(source)
