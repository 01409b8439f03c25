"""One step run for every pad: here, in processes, or on a cluster; what is finished is kept."""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, ClassVar, Protocol
from uuid import uuid4

from qlvbayes.diagnosis.result import DiagnosisResult
from qlvbayes.fitting.residuals import CheckResult
from qlvbayes.fitting.summary import FitSummary
from qlvbayes.io.checks import InputError
from qlvbayes.io.data import Measurements
from qlvbayes.io.files import results_folder, same_folder, write_json, write_whole
from qlvbayes.parallel.engines import Engine
from qlvbayes.parallel.faults import FailedError, Fault
from qlvbayes.parallel.running import Outcome, package_digest, run_all
from qlvbayes.pipeline.source import Source
from qlvbayes.pipeline.watcher import Watcher

FINISHED = ".finished"
"""Folder in that of the results: of each step and pad what it was made from and what it left."""


_READING = "reading"  # what fails before there is a pad


class Step(Protocol):
    """What is done with a pad: a frozen record of all that it depends on, which can be pickled.

    name: of the step; reads: files of the pad's folder that it needs.
    """

    name: ClassVar[str]
    reads: ClassVar[tuple[str, ...]]

    def run(self, folder: Path, study: Measurements, watcher: Watcher) -> None:
        """Do it for the one pad of ``study``; leave the results in its folder."""
        ...

    def tell(self, folder: Path, watcher: Watcher) -> None:
        """Say what an earlier run left, as ``run`` said it."""
        ...


@dataclass(frozen=True, eq=False)
class Work:
    """A step for one pad, as it goes to whatever does it.

    look: settings of Matplotlib over the package's own; code: digest of the package; token: a file
    that who shares the disk sees, None where all do; given: contents of the files that are read.
    """

    step: Step
    study: Measurements
    folder: Path
    look: dict[str, Any] = field(default_factory=dict)
    code: str = ""
    token: Path | None = None
    given: dict[str, bytes] = field(default_factory=dict)

    @property
    def pad(self) -> str:
        """Its name."""
        return self.study.pads[0].name

    @property
    def key(self) -> str:
        """Digest of all that the results depend on."""
        choices = getattr(self.step, "choices", None)
        own = [getattr(choices, name, None) for name in ("effects_file", "laws_file")]
        parts = [
            repr(self.step), self.study.sha256, str(Path(self.study.source).resolve()), self.pad,
            repr(sorted(map(str, self.look.items()))), self.code,
            *(_digest(Path(file)) for file in own if file),
        ]  # fmt: skip
        return hashlib.sha256("\n".join(parts).encode()).hexdigest()


@dataclass(frozen=True, eq=False)
class Done:
    """What a step left: files by name with their digests, and contents where they must travel.

    told: what it said; None where it was finished before.
    """

    told: list[tuple[str, tuple[Any, ...]]] | None
    files: dict[str, str] = field(default_factory=dict)
    contents: dict[str, bytes] = field(default_factory=dict)


class Finished:
    """Of one step: which pads are finished, and which failed; a small file each."""

    def __init__(self, out: Path, step: str) -> None:
        self._folder = out / FINISHED / step

    def has(self, work: Work) -> bool:
        """Whether it was done from the same things before, and all that it left is still there."""
        try:
            noted = json.loads(self._file(work.pad).read_bytes())
            files: dict[str, str] = noted["files"]
            same = noted["key"] == work.key
        except (OSError, ValueError, KeyError, TypeError):
            return False
        return same and all(_digest(work.folder / name) == sha for name, sha in files.items())

    def add(self, work: Work, done: Done) -> None:
        """Note what was left."""
        self._write(work.pad, {"key": work.key, "files": done.files})

    def fail(self, name: str, fault: Fault) -> None:
        """Note why there is nothing."""
        noted = {"fault": fault.text, "mendable": fault.mendable, "of": fault.of}
        self._write(name, noted)

    def forget(self, name: str) -> None:
        """What was noted before."""
        with suppress(OSError):
            self._file(name).unlink()

    def _write(self, name: str, content: dict[str, Any]) -> None:
        self._folder.mkdir(parents=True, exist_ok=True)
        write_json(self._file(name), content)

    def _file(self, name: str) -> Path:
        return self._folder / f"{name}.json"


def faults_in(out: Path) -> list[Fault]:
    """Of all steps, those that were noted and not mended since."""
    found = []
    for file in sorted(out.glob(f"{FINISHED}/*/*.json")):
        noted = json.loads(file.read_bytes())
        if "fault" in noted:
            found.append(Fault(noted["fault"], noted["mendable"], noted["of"]))
    return found


@dataclass(frozen=True)
class Tally:
    """Which pads are done, in order, and what became of the others."""

    pads: tuple[str, ...]
    faults: tuple[Fault, ...]

    @property
    def total(self) -> int:
        """All of them."""
        return len(self.pads) + len(self.faults)


def run_pads(
    out: Path,
    work: Iterable[Work | Fault],
    *,
    size: int,
    engine: Engine | None = None,
    watcher: Watcher | None = None,
) -> Tally:
    """Do the work of one step, pad by pad or side by side; keep what is finished.

    What an earlier run finished from the same things is told, not done again. A pad that fails does
    not stop the others. What is told, and what is left, is the same whatever works.

    Parameters
    ----------
    out
        The folder of results.
    work
        One pad after the other, taken as it is needed; a fault for what could not be read.
    size
        How many there will be, as far as that is known.
    engine
        What works; this process itself where it is None.
    watcher
        Is told of each pad in turn, and how many are done.

    Raises
    ------
    EngineLostError
        A scheduler has gone.
    """
    watcher = watcher or Watcher()
    pads: list[str] = []
    faults: list[Fault] = []
    names: set[str] = set()
    reached = 0
    with (
        _seen_by_workers(out, engine) as token,
        watcher.overall(size, alone=engine is None) as tell,
    ):

        def keep(outcome: Outcome[Work, Done]) -> None:
            nonlocal reached
            reached += 1
            _keep(out, outcome)
            tell(reached, max(size, reached))

        todo = _todo(out, work, token, names)
        task = partial(_done_here, watcher) if engine is None else _done_elsewhere
        for outcome in run_all(task, todo, engine, keep=keep):
            if outcome.fault is not None:
                faults.append(_named(outcome))
                continue
            assert outcome.answer is not None
            pads.append(outcome.item.pad)
            if outcome.answer.told is None:
                outcome.item.step.tell(outcome.item.folder, watcher)
            _replay(outcome.answer.told or [], watcher, outcome.item.folder)
    return Tally(tuple(pads), tuple(faults))


def run_step(
    out: Path,
    source: Source,
    step: Callable[[Measurements], Step],
    *,
    engine: Engine | None = None,
    watcher: Watcher | None = None,
) -> Tally:
    """`run_pads` of a step that is made for each pad's measurements, into ``out/<pad>``."""
    work = (
        one if isinstance(one, Fault) else Work(step(one), one, out / one.pads[0].name)
        for one in source
    )
    done = run_pads(out, work, size=source.size, engine=engine, watcher=watcher)
    if not done.total and source.only and source.shard.count == 1:
        raise InputError(f"no pad of these files is called {' or '.join(source.only)}")
    return done


def raise_failed(tallies: Sequence[Tally], results: Sequence[Any] = ()) -> None:
    """FailedError where pads failed in one of the steps; the first step saw all of them."""
    faults = [fault for tally in tallies for fault in tally.faults]
    if faults:
        raise FailedError(faults, tallies[0].total, results)


def _todo(
    out: Path, work: Iterable[Work | Fault], token: Path | None, names: set[str]
) -> Iterator[Work | Fault | Outcome[Work, Done]]:
    """What goes to the workers, complete; what is finished already passes by them."""
    for one in work:
        if isinstance(one, Fault):
            yield one
            continue
        one = replace(one, look=_own_look(), code=package_digest(), token=token)
        if same_folder(one.pad) in names:
            text = f"{one.study.source}: another pad of these files is called '{one.pad}' too"
            yield Fault(f"{text}; rename the file or the pad", of=one.pad)
            continue
        names.add(same_folder(one.pad))
        Finished(out, _READING).forget(Path(one.study.source).name)
        if Finished(out, one.step.name).has(one):
            yield Outcome(one, Done(None))
            continue
        if token is not None:
            there = {name: one.folder / name for name in one.step.reads}
            one.given.update({n: f.read_bytes() for n, f in there.items() if f.exists()})
        yield one


def _keep(out: Path, outcome: Outcome[Work, Done]) -> None:
    """Write what was sent back, and note that it is finished, or why it is not."""
    if outcome.fault is not None:
        fault = _named(outcome)
        work = outcome.item
        step, name = (work.step.name, work.pad) if isinstance(work, Work) else (_READING, fault.of)
        if out.is_dir():
            Finished(out, step).fail(name, fault)
        return
    done, work = outcome.answer, outcome.item
    assert done is not None
    if done.told is None:  # finished before
        return
    for name, content in done.contents.items():
        path = work.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, content)
    done.contents.clear()
    work.given.clear()
    Finished(out, work.step.name).add(work, done)


def _named(outcome: Outcome[Work, Done]) -> Fault:
    assert outcome.fault is not None
    if isinstance(outcome.item, Work):
        return replace(outcome.fault, of=f"pad {outcome.item.pad}")
    return outcome.fault


def _done_here(watcher: Watcher, work: Work) -> Done:
    """In this process, which says what it does while it does it."""
    return Done([], _left_by(work, work.folder, watcher))


def _done_elsewhere(work: Work) -> Done:
    """In a worker: what it says, and where it has no part of the disk what it leaves, goes back."""
    with _looking(work.look):
        if work.token is None or work.token.exists():
            recorder = Recorder(work.folder)
            return Done(recorder.told, _left_by(work, work.folder, recorder))
        with TemporaryDirectory() as place:
            folder = Path(place) / work.folder.name
            folder.mkdir()
            for name, content in work.given.items():
                (folder / name).write_bytes(content)
            recorder = Recorder(folder)
            files = _left_by(work, folder, recorder)
            contents = {name: (folder / name).read_bytes() for name in files}
            return Done(recorder.told, files, contents)


def _left_by(work: Work, folder: Path, watcher: Watcher) -> dict[str, str]:
    """Do the step; the files that it wrote, with their digests."""
    before = _stamps(folder)
    work.step.run(folder, work.study, watcher)
    after = _stamps(folder)
    return {
        path.relative_to(folder).as_posix(): _digest(path)
        for path, stamp in after.items()
        if before.get(path) != stamp
    }


def _stamps(folder: Path) -> dict[Path, tuple[int, int, int]]:
    """What changes when a file is written anew."""
    found = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            stat = path.stat()
            found[path] = stat.st_ino, stat.st_mtime_ns, stat.st_size
    return found


def _digest(path: Path) -> str:
    """Of a file's content; empty where there is none."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return ""


@contextmanager
def _seen_by_workers(out: Path, engine: Engine | None) -> Iterator[Path | None]:
    """A file by which workers see whether they share the disk; None where they are sure to."""
    if engine is None or engine.shares_disk:
        yield None
        return
    token = results_folder(out).resolve() / f".shared-{uuid4().hex}"
    token.touch()
    try:
        yield token
    finally:
        token.unlink(missing_ok=True)


class Recorder(Watcher):
    """Keeps what is told, to be told again in another process; the folder is then another one."""

    def __init__(self, folder: Path) -> None:
        self.told: list[tuple[str, tuple[Any, ...]]] = []
        self._folder = folder

    def notice(self, text: str) -> None:
        """Something that the user should know."""
        self.told.append(("notice", (text,)))

    def starting(self, lines: Sequence[str]) -> None:
        """A pad is about to be fitted."""
        self.told.append(("starting", (lines,)))

    def fitted(self, summary: FitSummary) -> None:
        """A pad has been fitted."""
        self.told.append(("fitted", (summary,)))

    def checked(self, check: CheckResult) -> None:
        """A fit has been checked."""
        self.told.append(("checked", (check,)))

    def diagnosed(
        self, result: DiagnosisResult, words: Sequence[str], figures: Sequence[Path]
    ) -> None:
        """A pad has its verdict."""
        names = tuple(path.relative_to(self._folder) for path in figures)
        self.told.append(("diagnosed", (result, tuple(words), names)))


def _replay(told: Sequence[tuple[str, tuple[Any, ...]]], watcher: Watcher, folder: Path) -> None:
    for name, arguments in told:
        if name == "diagnosed":
            result, words, figures = arguments
            watcher.diagnosed(result, words, [folder / path for path in figures])
        else:
            getattr(watcher, name)(*arguments)


def _own_look() -> dict[str, Any]:
    """Of the user, over the package's own; nothing is imported to learn that there is none."""
    style = sys.modules.get("qlvbayes.plots.style")
    return {} if style is None else style.own_look()


def _looking(look: dict[str, Any]) -> Any:
    if not look:
        return nullcontext()
    from qlvbayes.plots.style import using

    return using(look)
