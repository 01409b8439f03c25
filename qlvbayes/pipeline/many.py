"""Run one step for every pad: in this process, in others, or on a cluster."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, ClassVar, Protocol, TypeVar, cast
from uuid import uuid4

from qlvbayes.io.checks import InputError
from qlvbayes.io.data import Measurements, Pad
from qlvbayes.io.files import alone_in, results_folder, same_folder, write_whole
from qlvbayes.parallel.engines import Engine
from qlvbayes.parallel.faults import FailedError, Fault
from qlvbayes.parallel.running import Outcome, package_digest, run_all
from qlvbayes.pipeline.finished import Finished, digest_of
from qlvbayes.pipeline.source import Source
from qlvbayes.pipeline.watcher import Message, Recorder, Watcher, replay

_READING = "reading"  # stands for the step where a file cannot be read and no pad is known

Answer = TypeVar("Answer")


class Step(Protocol):
    """Work done with each pad: a frozen record of its settings, which can be pickled."""

    name: ClassVar[str]  # name of the step
    reads: ClassVar[tuple[str, ...]]  # names of the files in the pad's folder that the step needs

    def run(self, folder: Path, study: Measurements, watcher: Watcher) -> None:
        """Do the step for the one pad of ``study`` and write the results into its folder."""
        ...

    def report_saved(self, folder: Path, watcher: Watcher) -> None:
        """Report the results of an earlier run, as ``run`` reported them."""
        ...


@dataclass(frozen=True, eq=False)
class Work:
    """Step for one pad, as it is sent to a worker."""

    step: Step
    study: Measurements
    folder: Path
    # Matplotlib settings of the user that differ from the package's
    style: dict[str, Any] = field(default_factory=dict)
    code: str = ""  # digest of the package
    # a file that only workers which share the disk can see, None where all of them share it
    token: Path | None = None
    # contents of the files that the step reads, for workers that do not
    inputs: dict[str, bytes] = field(default_factory=dict)

    @property
    def pad(self) -> str:
        """Name of the pad."""
        return self.study.pads[0].name

    @property
    def key(self) -> str:
        """Digest of all that the results depend on: step, measurements, style and code."""
        choices = getattr(self.step, "choices", None)
        own = [getattr(choices, name, None) for name in ("effects_file", "laws_file")]
        parts = [
            repr(self.step), self.study.sha256, str(Path(self.study.source).resolve()), self.pad,
            repr(sorted(map(str, self.style.items()))), self.code,
            *(digest_of(Path(file)) for file in own if file),
        ]  # fmt: skip
        return hashlib.sha256("\n".join(parts).encode()).hexdigest()


@dataclass(frozen=True, eq=False)
class Done:
    """Files that a step has written, and what it has reported."""

    messages: list[Message] | None  # what it reported, None where an earlier run had finished it
    files: dict[str, str] = field(default_factory=dict)  # digests by file name
    # by file name, where the worker does not share the disk
    contents: dict[str, bytes] = field(default_factory=dict)


@dataclass(frozen=True)
class Tally:
    """Names of the pads that are done, in order, and the faults of the others."""

    pads: tuple[str, ...]
    faults: tuple[Fault, ...]

    @property
    def total(self) -> int:
        """Number of all pads."""
        return len(self.pads) + len(self.faults)


def run_pads(
    out: Path,
    work: Iterable[Work | Fault],
    *,
    size: int,
    engine: Engine | None = None,
    watcher: Watcher | None = None,
) -> Tally:
    """Do one step for all pads, one after the other or in parallel."""
    watcher = watcher or Watcher()
    pads: list[str] = []
    faults: list[Fault] = []
    names: set[str] = set()
    reached = 0
    with (
        _shared_disk_token(out, engine) as token,
        watcher.overall(size, alone=engine is None) as report_count,
    ):

        def keep(outcome: Outcome[Work, Done]) -> None:
            nonlocal reached
            reached += 1
            _keep(out, outcome)
            report_count(reached, max(size, reached))

        todo = _todo(out, work, token, names)
        task = partial(_done_here, watcher) if engine is None else _done_elsewhere
        for outcome in run_all(task, todo, engine, keep=keep):
            if outcome.fault is not None:
                faults.append(_fault_with_pad(outcome))
                continue
            assert outcome.answer is not None
            pads.append(outcome.item.pad)
            if outcome.answer.messages is None:
                outcome.item.step.report_saved(outcome.item.folder, watcher)
            replay(outcome.answer.messages or [], watcher, outcome.item.folder)
    return Tally(tuple(pads), tuple(faults))


def run_step(
    out: Path,
    source: Source,
    step: Callable[[Measurements], Step],
    *,
    engine: Engine | None = None,
    watcher: Watcher | None = None,
) -> Tally:
    """Do `run_pads` with a step that is made for each pad's measurements, into ``out/<pad>``."""
    work = (
        one if isinstance(one, Fault) else Work(step(one), one, out / one.pads[0].name)
        for one in source
    )
    tally = run_pads(out, work, size=source.size, engine=engine, watcher=watcher)
    if not tally.total and source.only and source.shard.count == 1:
        raise InputError(f"no pad of these files is called {' or '.join(source.only)}")
    return tally


def map_pads(
    engine: Engine | None, task: Callable[[Pad], Answer], pads: Sequence[Pad]
) -> list[Answer]:
    """Return the task's answers for the pads, in order, from an engine or from this process."""
    if engine is None or len(pads) < 2:
        return list(map(task, pads))
    outcomes = list(run_all(partial(_styled, _own_style(), task), pads, engine))
    faults = [replace(o.fault, of=f"pad {o.item.name}") for o in outcomes if o.fault is not None]
    if faults:
        raise FailedError(faults, len(faults))
    return [cast(Answer, outcome.answer) for outcome in outcomes]


def _styled(style: dict[str, Any], task: Callable[[Pad], Answer], pad: Pad) -> Answer:
    with _with_style(style):
        return task(pad)


def raise_failed(tallies: Sequence[Tally], results: Sequence[Any] = ()) -> None:
    """Raise FailedError where pads failed in one of the steps; the first step had all pads."""
    faults = [fault for tally in tallies for fault in tally.faults]
    if faults:
        raise FailedError(faults, tallies[0].total, results)


def _todo(
    out: Path, work: Iterable[Work | Fault], token: Path | None, names: set[str]
) -> Iterator[Work | Fault | Outcome[Work, Done]]:
    """Yield the work for the engine, complete, and outcomes for what is finished already."""
    for one in work:
        if isinstance(one, Fault):
            yield one
            continue
        one = replace(one, style=_own_style(), code=package_digest(), token=token)
        if same_folder(one.pad) in names:
            text = f"{one.study.source}: another pad of these files is called '{one.pad}' too"
            yield Fault(f"{text}; rename the file or the pad", of=one.pad)
            continue
        names.add(same_folder(one.pad))
        Finished(out, _READING).forget(Path(one.study.source).name)
        if Finished(out, one.step.name).has(one.pad, one.key, one.folder):
            yield Outcome(one, Done(None))
            continue
        if token is not None:
            there = {name: one.folder / name for name in one.step.reads}
            one.inputs.update({n: f.read_bytes() for n, f in there.items() if f.exists()})
        yield one


def _keep(out: Path, outcome: Outcome[Work, Done]) -> None:
    """Write the files that a worker sent back; record that the pad is finished, or its fault."""
    if outcome.fault is not None:
        fault = _fault_with_pad(outcome)
        work = outcome.item
        step, name = (work.step.name, work.pad) if isinstance(work, Work) else (_READING, fault.of)
        if out.is_dir():
            Finished(out, step).fail(name, fault)
        return
    done, work = outcome.answer, outcome.item
    assert done is not None
    if done.messages is None:  # an earlier run finished it
        return
    for name, content in done.contents.items():
        path = work.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, content)
    done.contents.clear()
    work.inputs.clear()
    Finished(out, work.step.name).add(work.pad, work.key, done.files)


def _fault_with_pad(outcome: Outcome[Work, Done]) -> Fault:
    assert outcome.fault is not None
    if isinstance(outcome.item, Work):
        return replace(outcome.fault, of=f"pad {outcome.item.pad}")
    return outcome.fault


def _done_here(watcher: Watcher, work: Work) -> Done:
    """Do a step in this process, which reports directly to the watcher."""
    return Done([], _files_written(work, work.folder, watcher))


def _done_elsewhere(work: Work) -> Done:
    """Do a step in a worker; send its messages back, and its files where the disk is not shared."""
    with _with_style(work.style):
        if work.token is None or work.token.exists():
            recorder = Recorder(work.folder)
            return Done(recorder.messages, _files_written(work, work.folder, recorder))
        with TemporaryDirectory() as base:
            folder = Path(base) / work.folder.name
            folder.mkdir()
            for name, content in work.inputs.items():
                (folder / name).write_bytes(content)
            recorder = Recorder(folder)
            files = _files_written(work, folder, recorder)
            contents = {name: (folder / name).read_bytes() for name in files}
            return Done(recorder.messages, files, contents)


def _files_written(work: Work, folder: Path, watcher: Watcher) -> dict[str, str]:
    """Do the step and return the digests of the files that it wrote, by name."""
    with alone_in(folder):
        before = _stamps(folder)
        work.step.run(folder, work.study, watcher)
        after = _stamps(folder)
    return {
        path.relative_to(folder).as_posix(): digest_of(path)
        for path, stamp in after.items()
        if before.get(path) != stamp
    }


def _stamps(folder: Path) -> dict[Path, tuple[int, int, int]]:
    """Return inode, time of change and size of every file: one differs when it is written anew."""
    stamps = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            stat = path.stat()
            stamps[path] = stat.st_ino, stat.st_mtime_ns, stat.st_size
    return stamps


@contextmanager
def _shared_disk_token(out: Path, engine: Engine | None) -> Iterator[Path | None]:
    """Yield a file that only workers which share the disk can see; None where all share it."""
    if engine is None or engine.shares_disk:
        yield None
        return
    token = results_folder(out).resolve() / f".shared-{uuid4().hex}"
    token.touch()
    try:
        yield token
    finally:
        token.unlink(missing_ok=True)


def _own_style() -> dict[str, Any]:
    """Return the user's Matplotlib settings; a module that was never imported has none."""
    style = sys.modules.get("qlvbayes.plots.style")
    return {} if style is None else style.own_look()


def _with_style(style: dict[str, Any]) -> Any:
    """Return a context in which figures have the user's Matplotlib settings."""
    if not style:
        return nullcontext()
    from qlvbayes.plots.style import using

    return using(style)
