"""Write results to disk, each file whole or not at all: in folders, and as records in JSON.

msgspec reads and checks records: it refuses a wrong type and names its location in the file. Keys
of the file that differ from the attribute's name are listed at the record's class, in ``rename``.
"""

from __future__ import annotations

import json
import os
import re
import unicodedata
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, ClassVar, Self

import msgspec
import numpy as np

from qlvbayes.io.checks import InputError
from qlvbayes.io.wording import prints

try:
    import fcntl
except ImportError:  # absent on some systems: folders are not locked there
    fcntl = None  # type: ignore[assignment]

_IN_RESULTS = (
    *(f"constants.{kind}" for kind in ("csv", "tex", "png", "pdf")),
    *(f"forces_at_rates.{kind}" for kind in ("png", "pdf")),
    *("compare", "report.html", "run.json", "look.json", "study.toml", "measurements.csv"),
    *("bench.json", "data.csv", "data.csv.gz", "-"),  # of the bench, which calls all pads '-'
)
"""Names in a folder of results that are not those of pads' folders."""
DESCRIBED = "described_effect.py"
"""Name of the file, in a pad's folder of results, that holds a described law as an effect."""
_PICTURE = re.compile(r"look_.*\.png")  # the picture of a pad's first look
_HALF_WRITTEN = re.compile(r"\.\d+\.part$")  # temporary names of `write_whole`
_LONGEST = 120  # bytes of a name: two of them fit into the 255 of a comparison's folder


def folder_fault(name: str) -> tuple[str, str] | None:
    """Return why a folder of results cannot have this name, and the remedy; None where it can."""
    if not name:
        return "is empty", "write its name"
    if "/" in name or "\\" in name or name.startswith("."):
        remedy = "write it without / and \\ and a leading point: results go to a folder so named"
        return "cannot name a folder", remedy
    if not all(map(prints, name)):
        return "has a character that does not print", "write it without"
    if len(name.encode()) > _LONGEST:
        return f"is longer than {_LONGEST} bytes", "write a shorter one: a folder is so named"
    if same_folder(name) in _IN_RESULTS or _PICTURE.fullmatch(same_folder(name)):
        return "is that of a file of results", "write another one: results go to a folder so named"
    return None


def same_folder(name: str) -> str:
    """Return a form of the name that is equal for names which some disks take for one."""
    return unicodedata.normalize("NFKC", name).casefold()


def stem_of(file: Path) -> str:
    """Return a file's name without its kind: of ``B.csv.gz`` B."""
    name = file.name.removesuffix(".gz")
    return name.rpartition(".")[0] or name


def results_folder(path: Path) -> Path:
    """Make a folder for results and check that it can be written; raise InputError otherwise."""
    probe = path / ".write-test"
    try:
        path.mkdir(parents=True, exist_ok=True)
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise InputError(
            f"cannot write results here ({error.strerror})",
            file=path,
            remedy="choose another folder with -o",
        ) from error
    return path


@contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Lock a folder of results, made if necessary, and remove what a killed run left."""
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    results_folder(folder)
    number = _locked(folder)
    try:
        for path in folder.rglob("*.part") if number is not None else ():
            if _HALF_WRITTEN.search(path.name):
                path.unlink(missing_ok=True)
        yield
    finally:
        if number is not None:
            os.close(number)
        with suppress(OSError):  # one that is not empty stays, and those above it
            for path in missing:
                path.rmdir()


def _locked(folder: Path) -> int | None:
    """Return the open folder, locked, or None where it cannot be locked."""
    if fcntl is None:
        return None
    try:
        number = os.open(folder, os.O_RDONLY)
    except OSError:
        return None
    try:
        fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(number)
        raise InputError(
            "another run is writing results here",
            file=folder,
            remedy="give the same command again when it has ended, or choose another folder",
        ) from None
    except OSError:
        os.close(number)
        return None
    return number


def write_whole(path: Path, content: bytes | memoryview) -> None:
    """Write under a temporary name, then rename; an OSError names the file where that fails."""
    part = path.with_name(f"{path.name}.{os.getpid()}.part")
    try:
        part.write_bytes(content)
        os.replace(part, path)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from error
    finally:
        part.unlink(missing_ok=True)


def write_json(path: Path, content: object, *, indent: int | None = 2) -> None:
    """Write JSON whose numbers are finite or null, whole or not at all."""
    text = json.dumps(content, indent=indent, allow_nan=False) + "\n"
    write_whole(path, text.encode())


_PACKAGE = Path(__file__).resolve().parents[1]


def bundled(name: str) -> Path:
    """Return the path of ``name`` (``hidden.csv``), without a file where it was not installed."""
    installed = _PACKAGE / "data" / name
    return installed if installed.is_file() else _PACKAGE.parent / "data" / name


# Records


class Part(msgspec.Struct, frozen=True):
    """Record inside a result."""


class Result(Part, frozen=True, kw_only=True, tag_field="schema", tag=1):
    """Record that has a file of its own; its key ``schema`` is the version of its keys.

    Unknown keys are ignored, so that a later version may add some.
    """

    indent: ClassVar[int | None] = 2

    def to_json(self) -> str:
        """Return the text of the file; raise ValueError where a number is not finite."""
        content = msgspec.to_builtins(self, enc_hook=_plain)
        return json.dumps(content, indent=self.indent, allow_nan=False) + "\n"

    def as_dict(self) -> dict[str, Any]:
        """Return the content of the file as plain Python."""
        return dict(json.loads(self.to_json()))

    @classmethod
    def from_json(cls, text: str | bytes, *, file: str | Path | None = None) -> Self:
        """Return the record from which the text was made."""
        try:
            return msgspec.json.decode(text, type=cls)
        except (msgspec.MsgspecError, InputError, UnicodeDecodeError) as error:
            known, schema = cls.__struct_config__.tag, _schema(text)
            if isinstance(known, int) and isinstance(schema, int) and schema > known:
                raise InputError(
                    f"written by a newer version of qlvbayes (schema {schema}, known is {known})",
                    file=file,
                    remedy="update qlvbayes, or run the command again",
                ) from error
            raise InputError(
                f"cannot be read as results of qlvbayes ({error})",
                file=file,
                remedy="run the command again",
            ) from error

    def write(self, path: str | Path) -> None:
        """Write the file, whole or not at all."""
        write_whole(Path(path), self.to_json().encode())

    @classmethod
    def read(cls, path: str | Path) -> Self:
        """Read a file."""
        return cls.from_json(Path(path).read_bytes(), file=path)


def _plain(value: object) -> object:
    """Return a number of numpy as a number of Python, as msgspec does not know numpy."""
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"a result cannot hold {type(value).__name__}")


def _schema(text: str | bytes) -> object:
    """Return the schema that a refused file states, or None."""
    try:
        content = msgspec.json.decode(text)
    except (msgspec.MsgspecError, UnicodeDecodeError):
        return None
    return content.get("schema") if isinstance(content, dict) else None
