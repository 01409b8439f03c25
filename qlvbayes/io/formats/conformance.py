"""Check the rules that every format has to keep, one by one or by one function."""

from __future__ import annotations

import inspect
import tempfile
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from qlvbayes.io.checks import InputError
from qlvbayes.io.conformance import Check, run_checks
from qlvbayes.io.formats.catalogue import FORMATS
from qlvbayes.io.formats.format import HEAD, Format, Recording, Sight
from qlvbayes.io.formats.machineunits import QUANTITIES

_WORDS = ("name", "machine", "marks", "reads", "reference")
_TIDY = b"pad,test,time_s,displacement_mm,force_N\nB,slow,0,0,0.01\nB,slow,0.01,0.02,0.03\n"
_CUTS = (0.999, 0.97, 0.7, 0.3, 0.05)  # shares of a file that remain when it is cut
_HEADS = (0, 1, 2, 3, 7, 64, 511, 1024)  # bytes that remain of a cut head


class FormatError(AssertionError):
    """Exception for a format that breaks a rule; the text says which rule."""


def check_format(kind: Format, files: Sequence[str | Path]) -> None:
    """Check that a format keeps the rules, on files of its own (two or more different ones).

    The format declares itself. It recognises its own files and no tidy file, and no other format
    claims them. It looks at any bytes without an error. It reads columns of one length with finite
    numbers, one for each quantity. From a file that is cut, has NULs or a byte order mark, or is
    UTF-16, it gives tests or an InputError and nothing else. A FormatError has a line for each rule
    that is broken.

    Parameters
    ----------
    kind, files
        The format's class; two or more files of it.
    """
    run_checks(format_checks(kind, files), FormatError)


def format_checks(kind: Format, files: Sequence[str | Path]) -> Iterator[Check]:
    """Yield name and function of each check of `check_format`, so that each is its own test.

    Parameters
    ----------
    kind, files
        As there: ``@pytest.mark.parametrize(("name", "check"), format_checks(MyFormat, FILES))``.
    """
    yield "declarations", partial(_check_declarations, kind, files)
    for name, rule in _RULES.items():
        for file in map(Path, files):
            yield f"{name}, {file.name}", partial(rule, kind, file)
    yield "tidy file", partial(_check_tidy, kind)


def _check_tidy(kind: Format) -> None:
    if kind.sniff(_TIDY).whole:
        raise FormatError(f"{kind.name} claims a tidy file")


def _check_declarations(kind: Format, files: Sequence[str | Path]) -> None:
    called = getattr(kind, "__name__", None) or kind.name
    if inspect.isabstract(kind):
        missing = ", ".join(sorted(getattr(kind, "__abstractmethods__", ())))
        raise FormatError(f"{called} lacks {missing}")
    for word in _WORDS:
        text = getattr(kind, word, "")
        if not text.strip() or "\n" in text:
            raise FormatError(f"{called}: {word} must be one line of text")
    if len(files) < 2:
        raise FormatError(f"{kind.name}: give two files or more, of different tests or machines")


def _head(file: Path) -> bytes:
    with file.open("rb") as opened:
        return opened.read(HEAD)


def _check_known(kind: Format, file: Path) -> None:
    sight = kind.sniff(_head(file))
    if not sight.whole:
        missing = ", ".join(sight.missing)
        raise FormatError(f"{kind.name} does not know its own file {file.name}: no {missing}")


def _check_alone(kind: Format, file: Path) -> None:
    head = _head(file)
    others = [o for o in FORMATS if o is not kind and (kind.general or not o.general)]
    claim = [other.name for other in others if other.sniff(head).whole]
    if claim:
        raise FormatError(f"{kind.name}: {', '.join(claim)} claims {file.name} too")


def _check_sniff(kind: Format, file: Path) -> None:
    head = _head(file)
    noise = np.random.default_rng(0).bytes(HEAD)
    odd = [head[:size] for size in _HEADS] + [noise, bytes(HEAD), b"\n" * 99, head[::2], head[::-1]]
    for some in odd:
        try:
            sight = kind.sniff(some)
        except Exception as error:
            what = f"{type(error).__name__}: {error}"
            raise FormatError(f"{kind.name}: sniff fails on some bytes ({what})") from error
        if not isinstance(sight, Sight):
            raise FormatError(f"{kind.name}: sniff must return a Sight")


def _check_recordings(kind: Format, file: Path) -> None:
    for recording in kind.read(file):
        _check_recording(kind, file, recording)


def _check_recording(kind: Format, file: Path, recording: Recording) -> None:
    channels = (recording.time, recording.way, recording.load)
    for channel, quantities in zip(channels, QUANTITIES, strict=True):
        if channel.quantity not in quantities:
            what = f"'{channel.name}' is {channel.quantity}, not {' or '.join(quantities)}"
            raise FormatError(f"{kind.name}, {file.name}: {what}")
        values = np.asarray(channel.values)
        if values.dtype != np.float64 or values.shape != recording.time.values.shape:
            raise FormatError(f"{kind.name}, {file.name}: '{channel.name}' is not (n,) of float64")
        if not np.isfinite(values).all():
            raise FormatError(f"{kind.name}, {file.name}: '{channel.name}' is not finite")


def _check_damage(kind: Format, file: Path) -> None:
    with tempfile.TemporaryDirectory() as folder:
        hurt = Path(folder) / file.name
        for what, data in _damaged(file.read_bytes()):
            hurt.write_bytes(data)
            try:
                kind.read(hurt)
            except InputError:
                continue
            except Exception as error:
                text = f"{type(error).__name__}: {error}"
                raise FormatError(
                    f"{kind.name}: reading {file.name} {what} ends in {text[:200]}"
                ) from error


def _damaged(data: bytes) -> Iterator[tuple[str, bytes]]:
    for share in _CUTS:
        yield f"cut to {share:.1%}", data[: int(share * len(data))]
    middle = len(data) // 2
    yield "with NULs", data[:middle] + bytes(9) + data[middle:]
    yield "with a byte order mark", b"\xef\xbb\xbf" + data
    yield "as UTF-16", data.decode("latin-1").encode("utf-16")
    yield "with nothing in it", b""


_RULES: dict[str, Callable[[Format, Path], None]] = {
    "known": _check_known,
    "alone": _check_alone,
    "any bytes": _check_sniff,
    "recordings": _check_recordings,
    "damaged": _check_damage,
}
