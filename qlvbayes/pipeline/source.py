"""Yield pads from files of measurements: by one rule for every command that reads.

A tidy file is a record of its own: its pads stay apart from those of other files, and are named
after the file too where there are several. Files of testing machines do not name pads: they are
tests of one pad, ``pad`` or as the user calls it, unless the names of their tests hold the pads'
(``--pad-from``). What was read of several of them lies in ``OUT/measurements.csv`` from then on.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

from qlvbayes.io.checks import InputError
from qlvbayes.io.conversion import Conversion, convert, tidy_text, write_tidy
from qlvbayes.io.data import Measurements, Pad, measurements_of, read_measurements
from qlvbayes.io.files import folder_fault, results_folder, same_folder, stem_of
from qlvbayes.io.formats import Format, known_formats, matching
from qlvbayes.io.layouts import TWO_CLOCKS
from qlvbayes.io.loading import Answers
from qlvbayes.io.text import head_of
from qlvbayes.io.tidy import sniff
from qlvbayes.io.units import PAD
from qlvbayes.io.wording import UNNAMED, as_typed, listed
from qlvbayes.parallel.running import Fault, Shard, fault_of

REFERENCES = "paper_table1.csv"
"""File of reference constants, next to the measurements, that is drawn with the pads' own."""
KEPT = "measurements.csv"
"""Tidy file, in a folder of results, of what was read of several files of testing machines."""
_NO_MEASUREMENTS = {
    ".html", ".ini", ".ipynb", ".jpg", ".json", ".log", ".m", ".md", ".mplstyle", ".nc", ".pdf",
    ".png", ".py", ".rst", ".sh", ".tex", ".toml", ".yaml", ".yml", ".zip",
}  # fmt: skip
"""Suffixes of files in a folder that hold no measurements; files of any other are read."""

Convert = Callable[[Sequence[Path], tuple[str, ...]], Conversion]
"""Function that converts files of testing machines, whose pads are called so."""
NamesAmong = Callable[[Collection[str]], list[str]]
"""Function that finds names of pads in the user's words, of which known ones may hold commas."""


@dataclass(frozen=True, eq=False)
class Source:
    """Source of pads, each as a study of its own, in the order of the files and within them."""

    files: tuple[Path, ...] = ()  # tidy files, of which one is read at a time
    only: tuple[str, ...] = ()  # names of the pads that are wanted, all by default
    read: Measurements | None = None  # measurements that are read: of one file, or of machines'
    folder: Path | None = None
    shard: Shard = field(default_factory=Shard)
    conversion: Conversion | None = None  # that of machines' files, where the user's words matter
    faults: tuple[Fault, ...] = ()  # of machines' files that could not be read

    @classmethod
    def from_files(
        cls,
        measurements: Measurements | str | Path | Sequence[str | Path],
        *,
        only: Sequence[str] | NamesAmong = (),
        shard: Shard | None = None,
        convert: Convert | None = None,
        stated: bool = False,
        pad_names: bool = True,
    ) -> Source:
        """Return the source of measurements: a file, several files, or a folder of them.

        ``convert`` reads files of testing machines; where the user has not ``stated`` how, a single
        one is read as every file is. ``only`` selects pads, or finds their names among
        known ones; it names those of machines' files unless ``pad_names`` is false, as the answers
        find them in the tests' names.
        """
        part = shard or Shard()
        names = () if callable(only) else tuple(only)
        named: NamesAmong = only if callable(only) else lambda known: list(names)
        if isinstance(measurements, str | Path):
            measurements = [measurements]
        if isinstance(measurements, Measurements):
            return cls(only=_known(measurements, named), read=measurements, shard=part)
        paths = [Path(one) for one in measurements]
        files = [file for path in paths for file in files_at(path)]
        folder = paths[0] if len(paths) == 1 and paths[0].is_dir() else None
        alone = len(files) == 1 and not stated and not named(())
        tidy = files if alone else [file for file in files if is_tidy(file, stated)]
        machines = [file for file in files if file not in tidy]
        if tidy and not machines and stated:
            what = "an option says how files of testing machines are read, and this one is tidy"
            raise InputError(what, file=tidy[0], remedy="leave the option out")
        if machines:
            return _of_machines(machines, tidy, named, folder, part, convert, pad_names)
        if len(tidy) == 1 and folder is None:
            study = read_measurements(tidy[0])
            return cls(only=_known(study, named), read=study, shard=part)
        _refuse_same_names(tidy)
        return cls(tuple(tidy), tuple(named(())), folder=folder, shard=part)

    @property
    def size(self) -> int:
        """Number of pads in this part; of several tidy files, the number of files."""
        return len(self.shard.part([*self._read_pads, *self.files]))

    @property
    def notices(self) -> tuple[str, ...]:
        """Notices from reading a single file, or files of testing machines."""
        return self.read.notices if self.read else ()

    @property
    def is_complete(self) -> bool:
        """True if all pads are known, and no file is still to be read."""
        return self.read is not None and not self.files

    @property
    def location(self) -> Path:
        """Folder that holds the files."""
        if self.read is not None:
            return Path(self.read.source).parent
        return self.folder or self.files[0].parent

    @property
    def whole(self) -> Measurements:
        """Measurements that are read, or an empty record that names the folder of several files."""
        return self.read or Measurements((), PAD, str(self.location), "", ())

    @property
    def grouping(self) -> str:
        """Return what the files are taken for, in words."""
        count = len(self.files)
        each = f"{count} tidy files, each" if count > 1 else "1 tidy file"
        pads = self._read_pads
        tests = ((pad.name, len(pad.tests)) for pad in pads)
        named = [f"pad {name} of {some} test{'' if some == 1 else 's'}" for name, some in tests]
        named += [f"{each} with pads of its own"] * bool(self.files)
        text = f"read: {listed(named)}"
        if self.conversion is not None and len(pads) == 1 and len(pads[0].tests) > 1:
            text += " (--pad NAME names it; --pad-from REGEX finds several pads in tests' names)"
        if self.files:
            text += " (tests of one pad stand in one file; look FILES -o P.csv --pad P joins them)"
        return text

    def _refusal(self) -> InputError:
        remedy = None
        if len(self.files) > 1 and len(self.only) == 1:
            (pad,), names = self.only, map(str, self.files)
            typed = as_typed("qlvbayes", "look", *names, "-o", f"{pad}.csv", "--pad", pad)
            remedy = f"each tidy file has pads of its own; this joins tests of one pad: {typed}"
        what = f"no pad of these files is called {' or '.join(self.only)}"
        return InputError(what, remedy=remedy)

    def kept(self, out: Path) -> Source:
        """Return the source whose machines' files are read from their tidy copy in ``out``.

        Later steps, which ask where the measurements are, then find them in one file.
        """
        if self.conversion is None:
            return self
        file = results_folder(out) / KEPT
        if not file.is_file() or file.read_bytes() != tidy_text(self.conversion):
            write_tidy(self.conversion, file)
        assert self.read is not None
        study = replace(read_measurements(file), notices=self.read.notices)
        return replace(self, read=study)

    def __iter__(self) -> Iterator[Measurements | Fault]:
        """Yield a study of each pad, and a fault for each file that cannot be read.

        InputError, at the end, where none has a pad of the names that are wanted.
        """
        found = False
        for one in self._all():
            found = True
            yield one
        if not found and self.only and self.shard.count == 1:
            raise self._refusal()

    def _all(self) -> Iterator[Measurements | Fault]:
        yield from self.faults if self.shard.index == 1 else ()
        every: list[Pad | Path] = [*self._read_pads, *self.files]
        for entry in self.shard.part(every):
            if isinstance(entry, Pad):
                assert self.read is not None
                yield alone(self.read, entry)
                continue
            try:
                study = named_after(entry, read_measurements(entry))
            except Exception as error:  # one bad file must not stop the others
                yield replace(fault_of(error), of=entry.name)
                continue
            for pad in self._selected(study):
                yield alone(study, pad)

    @cached_property
    def _read_pads(self) -> list[Pad]:
        return self._selected(self.read) if self.read is not None else []

    def _selected(self, study: Measurements) -> list[Pad]:
        known = {pad.name: pad for pad in study.pads}
        return [known[name] for name in self.only or known if name in known]


def _of_machines(
    machines: Sequence[Path],
    tidy: Sequence[Path],
    named: NamesAmong,
    folder: Path | None,
    part: Shard,
    given: Convert | None,
    pad_names: bool,
) -> Source:
    """Return the source of machines' files, which are read together, beside tidy ones."""
    given = given or (
        lambda files, pads: convert(files, Answers.from_words(pads=pads), without_faulty=True)
    )
    names = () if tidy or not pad_names else tuple(named(()))
    faults: list[InputError] = []
    left = list(machines)
    while True:
        try:
            conversion = given(left, names)
            break
        except InputError as error:  # of all files, or of one that stops the others
            rest = [file for file in left if str(file) != str(error.file)]
            if not rest or len(rest) == len(left) or names:
                raise
            faults.append(error)
            left = rest
    every = (*faults, *conversion.faults)
    failed = tuple(replace(fault_of(one), of=Path(str(one.file)).name) for one in every)
    digest = hashlib.sha256(tidy_text(conversion)).hexdigest()
    study = measurements_of(conversion, str(machines[0]), digest)
    wanted = tuple(named(())) if tidy else () if names else _known(study, named)
    _refuse_same_names(tidy)
    return Source(tuple(tidy), wanted, study, folder, part, conversion, failed)


def is_tidy(file: Path, asked: bool = False) -> bool:
    """Return whether a file is tidy, as `read_measurements` takes it; none is both.

    asked: whether the user has said how machines' files are read: then all others are theirs.
    """
    try:
        dialect = sniff(file)
    except InputError:
        return not asked and not _matches(file, known_formats())
    return not dialect.ignored or not (asked or _matches(file, (TWO_CLOCKS,)))


def _matches(file: Path, formats: Sequence[Format]) -> bool:
    try:
        return bool(matching(head_of(file), formats))
    except InputError:
        return False


def alone(study: Measurements, pad: Pad) -> Measurements:
    """Return one pad of a study as a study."""
    return Measurements((pad,), study.units, study.source, study.sha256, study.notices)


def named_after(file: Path, study: Measurements) -> Measurements:
    """Return the study of one file among several, with pad names that no other file has."""
    stem = stem_of(file)
    pads = []
    for pad in study.pads:
        same = len(study.pads) == 1 and pad.name in (UNNAMED, stem)
        name = stem if same else f"{stem}-{pad.name}"
        if (fault := folder_fault(name)) is not None:
            raise InputError(f"'{name}' {fault[0]}", file=file, remedy=fault[1])
        tests = tuple(replace(test, pad=name) for test in pad.tests)
        pads.append(replace(pad, name=name, tests=tests))
    return replace(study, pads=tuple(pads))


def pad_of(study: Measurements, name: str) -> Measurements:
    """Return a study of one pad, by its name among several files or in its own."""
    if name not in [pad.name for pad in study.pads]:
        renamed = named_after(Path(study.source), study)
        if name in [pad.name for pad in renamed.pads]:
            return alone(study, renamed.pad(name))
    return alone(study, study.pad(name))


def read_again(source: str, sha256: str, data: Path | None = None) -> Measurements:
    """Return the measurements of results, from where these say that they are, or from ``data``.

    ``data`` is the file or its folder, if it has moved. InputError where it is gone or another.
    """
    file, remedy = Path(source), "say where they are with --data FILE"
    if data is not None:
        file = data / file.name if data.is_dir() else data
    if not file.name:  # of draws that were made elsewhere
        raise InputError("a posterior does not say where its measurements are", remedy=remedy)
    if not file.is_file():
        raise InputError("the measurements are no longer here", file=file, remedy=remedy)
    study = read_measurements(file)
    if sha256 not in ("", study.sha256):
        what, remedy = "the file has changed since the fit", "run qlvbayes fit again"
        raise InputError(what, file=file, remedy=remedy)
    return study


def _known(study: Measurements, named: NamesAmong) -> tuple[str, ...]:
    return tuple(study.pad(name).name for name in named([pad.name for pad in study.pads]))


def files_at(path: Path) -> list[Path]:
    """Return the file, or those files of a folder that may hold measurements."""
    if not path.is_dir():
        return [path]
    named = (one for one in sorted(path.iterdir()) if one.is_file() and one.name != REFERENCES)
    files = [
        x for x in named
        if not x.name.startswith(".") and x.suffix.lower() not in _NO_MEASUREMENTS
    ]  # fmt: skip
    if not files:
        remedy = "name a folder with files of them"
        raise InputError("no measurements in this folder", file=path, remedy=remedy)
    return files


def _refuse_same_names(files: Sequence[Path]) -> None:
    """Refuse files whose pads would go to one folder."""
    seen: dict[str, Path] = {}
    for file in files:
        other = seen.setdefault(same_folder(stem_of(file)), file)
        if other != file:
            what = f"{other.name} and this file give pads one name"
            remedy = "rename one: of several files each pad is named after its own"
            raise InputError(what, file=file, remedy=remedy)
