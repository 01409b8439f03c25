"""Run the steps of every pad: in this process, in others, or on a cluster."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeVar, cast
from uuid import uuid4

from qlvbayes.io.data import Measurements, Pad
from qlvbayes.io.files import alone_in, results_folder, same_folder, write_whole
from qlvbayes.parallel.engines import Engine
from qlvbayes.parallel.running import FailedError, Fault, Outcome, package_digest, run_all
from qlvbayes.pipeline.steps import (
    Step,
    Watcher,
    digest_of,
    forget_fault,
    is_finished,
    record_fault,
    record_finished,
)

Answer = TypeVar("Answer")


@dataclass(frozen=True, eq=False)
class Work:
    """Steps of one pad, one after the other, as they are sent to a worker."""

    steps: tuple[Step, ...]
    study: Measurements
    out: Path
    todo: tuple[Step, ...] = ()  # those that are not finished
    style: dict[str, Any] = field(default_factory=dict)  # Matplotlib settings of the user
    # a file that only workers which share the disk can see, None where all do; for those that do
    # not, ``inputs`` are the contents of the files that the steps need
    token: Path | None = None
    inputs: dict[str, bytes] = field(default_factory=dict)

    @property
    def pad(self) -> str:
        """Name of the pad."""
        return self.study.pads[0].name

    def key(self, step: Step, folder: Path) -> str:
        """Return the digest of all that a step's results depend on.

        These are its settings, the measurements, the files that it needs, the user's own laws and
        effects, the style of figures, and the code that it computes with; that of figures is not
        among them, so that an edited figure invalidates no fit.
        """
        choices, source = getattr(step, "choices", None), Path(self.study.source).resolve()
        own = [getattr(choices, name, None) for name in ("effects_file", "laws_file")]
        parts = [
            repr(step), self.study.sha256, str(source), self.pad,
            repr(sorted(map(str, self.style.items()))), package_digest(step.code),
            *(digest_of(Path(file)) for file in own if file),
            *(digest_of(folder / step.within / name) for name in step.needs),
        ]  # fmt: skip
        return hashlib.sha256("\n".join(parts).encode()).hexdigest()

    def ready(self, token: Path | None) -> Work:
        """Return the work as it is sent: with the steps that are to be done, and what they need.

        A step is finished if its key is that of its last run, and none that it needs is done anew.
        """
        folder = self.out / self.pad
        work, todo = replace(self, style=_own_style(), token=token), list[Step]()
        for step in self.steps:
            record = step.label, self.pad, work.key(step, folder), folder
            if not is_finished(self.out, *record) or (todo and step.needs):
                todo.append(step)
        needed = {folder / step.within / name for step in todo for name in step.needs}
        known = [path for path in needed if path.exists()] if token is not None else []
        return replace(work, todo=tuple(todo), inputs=_contents(known, self.out))

    def report(self, step: Step, watcher: Watcher) -> None:
        """Report the results of a step."""
        step.report(self.out / self.pad / step.within, watcher)

    def do(
        self, out: Path, watcher: Watcher, report: Callable[[Step], None] = lambda step: None
    ) -> list[Path]:
        """Do the unfinished steps, record each as finished, and return all files written.

        ``report`` receives each step of the pad when it is finished, in order.
        """
        folder = out / self.pad
        written: list[Path] = []
        with alone_in(folder):
            for step in self.steps:
                if step in self.todo:
                    before, key = _stamps(folder), self.key(step, folder)
                    step.run(folder / step.within, self.study, watcher)
                    left = [path for path, s in _stamps(folder).items() if before.get(path) != s]
                    files = {path.relative_to(folder).as_posix(): digest_of(path) for path in left}
                    written += [*left, record_finished(out, step.label, self.pad, key, files)]
                report(step)
        return written


@dataclass(frozen=True, eq=False)
class Done:
    """Answer of a worker: what it told before fits; files by path, where they share no disk."""

    starting: tuple[tuple[str, ...], ...] = ()
    contents: dict[str, bytes] = field(default_factory=dict)


@dataclass(frozen=True)
class Tally:
    """Names of the pads that are done, in order, and the faults of the others."""

    pads: tuple[str, ...]
    faults: tuple[Fault, ...]

    def raise_failed(self, results: Sequence[Any] = ()) -> None:
        """Raise FailedError where pads failed; ``results`` are those of the others."""
        if self.faults:
            raise FailedError(self.faults, len(self.pads) + len(self.faults), results)


def run_pads(
    out: Path,
    studies: Iterable[Measurements | Fault],
    steps: Callable[[Measurements], Sequence[Step]],
    *,
    size: int,
    engine: Engine | None = None,
    watcher: Watcher | None = None,
) -> Tally:
    """Do the steps that are made for each pad's study, in ``out/<pad>``; skip what is finished."""
    watcher = watcher or Watcher()
    pads: list[str] = []
    faults: list[Fault] = []
    reached = count(1)
    work = (one if isinstance(one, Fault) else Work(tuple(steps(one)), one, out) for one in studies)
    with (
        _shared_disk_token(out, engine) as token,
        watcher.overall(size, alone=engine is None) as report_count,
    ):

        def keep(outcome: Outcome) -> None:
            """Write the files that a worker sent back, or record the fault."""
            if outcome.fault is None:
                _write(outcome.answer.contents, out)
                outcome.answer.contents.clear()
                outcome.item.inputs.clear()
            elif out.is_dir():
                fault = _with_pad(outcome)
                record_fault(out, getattr(outcome.item, "pad", fault.of), fault)
            report_count(number := next(reached), max(size, number))

        task = partial(_done_here, watcher) if engine is None else _done_elsewhere
        for outcome in run_all(task, _ready(work, token), engine, keep=keep):
            one: Work = outcome.item
            if outcome.fault is not None:
                faults.append(_with_pad(outcome))
                continue
            pads.append(one.pad)
            for lines in outcome.answer.starting:
                watcher.starting(lines)
            for step in one.steps if engine is not None or not one.todo else ():
                one.report(step, watcher)
    return Tally(tuple(pads), tuple(faults))


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
    return [outcome.answer for outcome in outcomes]


def _styled(style: dict[str, Any], task: Callable[[Pad], Answer], pad: Pad) -> Answer:
    with _with_style(style):
        return task(pad)


def _ready(work: Iterable[Work | Fault], token: Path | None) -> Iterator[Work | Fault | Outcome]:
    """Yield the work for the engine, and outcomes for what is finished already."""
    names: set[str] = set()
    for one in work:
        if isinstance(one, Fault):
            yield one
        elif same_folder(one.pad) in names:
            text = f"{one.study.source}: another pad of these files is called '{one.pad}' too"
            yield Fault(f"{text}; rename the file or the pad", of=one.pad)
        else:
            names.add(same_folder(one.pad))
            for name in (one.pad, Path(one.study.source).name):
                forget_fault(one.out, name)
            ready = one.ready(token)
            yield ready if ready.todo else Outcome(ready, Done())


def _with_pad(outcome: Outcome) -> Fault:
    fault, item = cast(Fault, outcome.fault), outcome.item
    return replace(fault, of=f"pad {item.pad}") if isinstance(item, Work) else fault


def _done_here(watcher: Watcher, work: Work) -> Done:
    """Do the steps in this process, and report each as soon as it is done."""
    work.do(work.out, watcher, lambda step: work.report(step, watcher))
    return Done()


def _done_elsewhere(work: Work) -> Done:
    """Do the steps in a worker; send files back where the disk is not shared."""
    watcher = _Starting()
    with _with_style(work.style):
        if work.token is None or work.token.exists():
            work.do(work.out, watcher)
            return Done(tuple(watcher.lines))
        with TemporaryDirectory() as base:
            _write(work.inputs, Path(base))
            files = work.do(Path(base), watcher)
            return Done(tuple(watcher.lines), _contents(files, Path(base)))


class _Starting(Watcher):
    """Watcher in a worker, which keeps what the user's process tells before the results."""

    def __init__(self) -> None:
        self.lines: list[tuple[str, ...]] = []

    def starting(self, lines: Sequence[str]) -> None:
        self.lines.append(tuple(lines))


def _contents(files: Iterable[Path], out: Path) -> dict[str, bytes]:
    return {path.relative_to(out).as_posix(): path.read_bytes() for path in files}


def _write(contents: dict[str, bytes], out: Path) -> None:
    for name, content in contents.items():
        (out / name).parent.mkdir(parents=True, exist_ok=True)
        write_whole(out / name, content)


def _stamps(folder: Path) -> dict[Path, tuple[int, int, int]]:
    """Return inode, time of change and size of every file: one differs when it is written anew."""
    stats = ((path, path.stat()) for path in sorted(folder.rglob("*")) if path.is_file())
    return {path: (stat.st_ino, stat.st_mtime_ns, stat.st_size) for path, stat in stats}


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
