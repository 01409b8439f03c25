"""Yield pads from one file of measurements, from several, or from a folder of them."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from qlvbayes.io.checks import InputError
from qlvbayes.io.data import Measurements, Pad, read_measurements
from qlvbayes.io.files import folder_fault, same_folder
from qlvbayes.io.units import PAD
from qlvbayes.parallel.faults import Fault, fault_of
from qlvbayes.parallel.shards import Shard

REFERENCES = "paper_table1.csv"
"""File of reference constants, next to the measurements, that is drawn with the pads' own."""
_UNNAMED = "pad"  # name of a file's only pad where no column names it
_NO_MEASUREMENTS = {
    ".html", ".ini", ".ipynb", ".jpg", ".json", ".log", ".m", ".md", ".mplstyle", ".nc", ".pdf",
    ".png", ".py", ".rst", ".sh", ".tex", ".toml", ".yaml", ".yml", ".zip",
}  # fmt: skip
"""Suffixes of files in a folder that hold no measurements; files of any other are read."""


@dataclass(frozen=True, eq=False)
class Source:
    """Source of pads, each as a study of its own, in the order of the files and within them."""

    files: tuple[Path, ...]  # where there are several, of which one is read at a time
    only: tuple[str, ...] = ()  # names of the pads that are wanted, all by default
    read: Measurements | None = None  # the measurements where they are in one file
    folder: Path | None = None
    shard: Shard = field(default_factory=Shard)

    @classmethod
    def from_files(
        cls,
        measurements: Measurements | str | Path | Sequence[str | Path],
        *,
        only: Sequence[str] = (),
        shard: Shard | None = None,
    ) -> Source:
        """Return the source of measurements: a file, several files, or a folder of them."""
        part = shard or Shard()
        if isinstance(measurements, str | Path):
            measurements = [measurements]
        if isinstance(measurements, Measurements):
            return cls((), _checked_names(measurements, only), measurements, shard=part)
        paths = [Path(one) for one in measurements]
        if len(paths) == 1 and not paths[0].is_dir():
            read = read_measurements(paths[0])
            return cls((paths[0],), _checked_names(read, only), read, shard=part)
        files = tuple(file for path in paths for file in files_at(path))
        _refuse_same_names(files)
        folder = paths[0] if len(paths) == 1 else None
        return cls(files, tuple(only), folder=folder, shard=part)

    @property
    def size(self) -> int:
        """Number of pads in this part; of several files, the number of files."""
        if self.read is None:
            return len(self.shard.part(self.files))
        return len(self.shard.part(self._selected(self.read)))

    @property
    def notices(self) -> tuple[str, ...]:
        """Notices from reading a single file."""
        return self.read.notices if self.read else ()

    @property
    def location(self) -> Path:
        """Folder that holds the files."""
        if self.read is not None:
            return Path(self.read.source).parent
        return self.folder or self.files[0].parent

    @property
    def whole(self) -> Measurements:
        """Measurements of the single file, or an empty record that names the folder of several."""
        return self.read or Measurements((), PAD, str(self.location), "", ())

    def __iter__(self) -> Iterator[Measurements | Fault]:
        """Yield a study of each pad, and a fault for each file that cannot be read."""
        if self.read is not None:
            for pad in self.shard.part(self._selected(self.read)):
                yield alone(self.read, pad)
            return
        for file in self.shard.part(self.files):
            try:
                study = named_after(file, read_measurements(file))
            except Exception as error:  # one bad file must not stop the others
                yield replace(fault_of(error), of=file.name)
                continue
            for pad in self._selected(study):
                yield alone(study, pad)

    def _selected(self, study: Measurements) -> list[Pad]:
        if not self.only:
            return list(study.pads)
        known = {pad.name: pad for pad in study.pads}
        return [known[name] for name in self.only if name in known]


def alone(study: Measurements, pad: Pad) -> Measurements:
    """Return one pad of a study as a study."""
    return Measurements((pad,), study.units, study.source, study.sha256, study.notices)


def named_after(file: Path, study: Measurements) -> Measurements:
    """Return the study of one file among several, with pad names that no other file has."""
    stem = _stem(file)
    pads = []
    for pad in study.pads:
        same = len(study.pads) == 1 and pad.name in (_UNNAMED, stem)
        name = stem if same else f"{stem}-{pad.name}"
        if (fault := folder_fault(name)) is not None:
            raise InputError(f"'{name}' {fault[0]}", file=file, remedy=fault[1])
        pads.append(renamed(pad, name))
    return replace(study, pads=tuple(pads))


def renamed(pad: Pad, name: str) -> Pad:
    """Return the same pad under another name."""
    return replace(pad, name=name, tests=tuple(replace(test, pad=name) for test in pad.tests))


def pad_of(study: Measurements, name: str) -> Measurements:
    """Return a study of one pad, by its name among several files or in its own."""
    known: Collection[str] = [pad.name for pad in study.pads]
    if name not in known:
        several = named_after(Path(study.source), study)
        if name in [pad.name for pad in several.pads]:
            return alone(study, several.pad(name))
    return alone(study, study.pad(name))


def _checked_names(study: Measurements, only: Sequence[str]) -> tuple[str, ...]:
    return tuple(study.pad(name).name for name in only)


def files_at(path: Path) -> list[Path]:
    """Return the file, or those files of a folder that may hold measurements."""
    if not path.is_dir():
        return [path]
    files = [
        file
        for file in sorted(path.iterdir())
        if file.is_file()
        and not file.name.startswith(".")
        and file.suffix.lower() not in _NO_MEASUREMENTS
        and file.name != REFERENCES
    ]
    if not files:
        raise InputError(
            "no measurements in this folder", file=path, remedy="name a folder with files of them"
        )
    return files


def _stem(file: Path) -> str:
    """Return a file's name without its kind: of ``B.csv.gz`` B."""
    name = file.name.removesuffix(".gz")
    return name.rpartition(".")[0] or name


def _refuse_same_names(files: Sequence[Path]) -> None:
    """Refuse files whose pads would go to one folder."""
    seen: dict[str, Path] = {}
    for file in files:
        other = seen.setdefault(same_folder(_stem(file)), file)
        if other != file:
            raise InputError(
                f"{other.name} and this file give pads one name",
                file=file,
                remedy="rename one: of several files each pad is named after its own",
            )
