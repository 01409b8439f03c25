"""Write results to disk, each file whole or not at all, and find measurements that come along."""

from __future__ import annotations

import json
import os
import re
import unicodedata
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from qlvbayes.io.checks import InputError
from qlvbayes.io.escaping import prints

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
