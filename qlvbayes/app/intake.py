"""Convert uploaded files to one tidy file in a session's folder, or to questions.

Nothing in a file is executed, and no name in it becomes a path.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from qlvbayes.app.sessions import ASKED, DATA
from qlvbayes.io.checks import InputError
from qlvbayes.io.conversion import Conversion, convert, in_short, write_tidy
from qlvbayes.io.data import read_measurements
from qlvbayes.io.files import results_folder
from qlvbayes.io.header import columns_in
from qlvbayes.io.loading import SIGNS, Answers, pattern_of
from qlvbayes.io.naming import DEFAULT_PAD, pad_in, suggested_pattern
from qlvbayes.io.recording import UnsureError
from qlvbayes.io.text import Lines, decoded, head_of
from qlvbayes.io.tidy import sniff
from qlvbayes.io.units import SUFFIXES
from qlvbayes.io.wording import plain

ONE, SEVERAL = "one", "several"  # answers to whether the tests are of one pad or of several
_HOW = "specimens"  # the name of that answer
_PAD = "pad{}"  # the answer that names the pad of a test, by the test's number
_SHOWN = 10  # lines of a file that are shown
_NAMES = {
    "time": r"time|zeit|^t$|\bt\b",
    "displacement": r"disp|pos|ext|depth|travel|stroke|crosshead|indent|weg|^d$|^x$|strain",
    "force": r"force|load|kraft|last|^f$|stress",
}
_UNITS = {
    "time": list(SUFFIXES["time"]),
    "displacement": [*SUFFIXES["displacement"], "strain"],
    "force": [*SUFFIXES["force"], *SUFFIXES["stress"]],
}
_WORDS = {"time": "time", "displacement": "displacement (or strain)", "force": "force (or stress)"}

Answer = dict[str, Any]


def read_in(folder: Path, uploads: Sequence[Path], answers: dict[str, str]) -> Answer:
    """Return the tidy file's path as ``data``, or ``questions``."""
    try:
        results_folder(folder)
        if not all(map(_is_tidy, uploads)):
            return _converted(folder, uploads, answers)
        if len(uploads) > 1:
            what = f"of {len(uploads)} files in tidy form each is a study of its own"
            raise InputError(what, remedy="open one, or write their rows into one file")
        read_measurements(file := uploads[0])  # it is copied as it is, once it can be read
        target = folder / (f"{DATA}.gz" if file.suffix.lower() == ".gz" else DATA)
        if not (target.is_file() and target.samefile(file)):
            shutil.copyfile(file, target)
        return {"data": str(target)}
    except InputError as error:
        raise _by_name(error, uploads) from error


def _is_tidy(file: Path) -> bool:
    try:
        sniff(file)
    except InputError:
        return False
    return True


def _converted(folder: Path, files: Sequence[Path], answers: dict[str, str]) -> Answer:
    """Convert files as ``look -o`` does, or return the one question that they leave open."""
    said = _said(answers)
    pads = _pads_of(answers)
    try:
        conversion = convert(files, Answers.from_words(**said, pads=pads))
    except UnsureError as error:
        return {"questions": _asked(error, files, answers)}
    if conversion.remarks:
        return {"questions": _asked_for_pads(conversion)}
    write_tidy(conversion, folder / DATA)
    options = {name: str(value) for name, value in said.items()}
    options |= {"pad": ",".join(pads)} if pads else {}
    made = {"files": [file.name for file in files], "options": options}
    return {"data": str(folder / DATA), "found": in_short(conversion.notices), "made": made}


def _said(answers: dict[str, str]) -> dict[str, Any]:
    """Return the options of ``look -o`` that answers state."""
    said: dict[str, Any] = {}
    for name, (first, last) in {"columns": ("", ""), "units": ("", "_unit")}.items():
        parts = [answers.get(f"{first}{what}{last}", "") for what in _NAMES]
        if any(parts):
            said[name] = ",".join(part.partition(":")[0] for part in parts)
    said |= {name: answers[name] for name in ASKED if answers.get(name)}
    if "area" in said:
        try:
            said["area"] = float(said["area"])
        except ValueError:
            text = f"{said['area']!r} is no number"
            raise InputError(text, remedy="give the area in mm2") from None
    return said


def _asked(error: UnsureError, files: Sequence[Path], answers: dict[str, str]) -> Answer:
    """Return the question of an error, with the first lines of the file that it is about."""
    file = next((one for one in files if str(one) == str(error.file)), files[0])
    lines, ask = "", []
    if error.option == "columns":
        lines_in = Lines.from_bytes(decoded(head_of(file)).encode())
        names = [f"{c.index + 1}: {c.written}" for c in columns_in(lines_in)]
        for what, pattern in _NAMES.items():
            alike = (n for n in names if re.search(pattern, n.partition(": ")[2], re.I))
            ask.append(_choice(what, f"the column of {_WORDS[what]}", names, next(alike, None)))
    elif error.option == "units":
        for what, units in _UNITS.items():  # as in a column's name: '(mm)' or after an underscore
            words = re.findall(r"[\w/%]+", answers.get(what, "").replace("_", " "))
            unit = next((word for word in reversed(words) if word in units), None)
            ask.append(_choice(f"{what}_unit", f"the unit of {_WORDS[what]}", units, unit))
    else:
        choices = list(SIGNS) if error.option == "sign" else None
        ask = [_choice(error.option, error.question, choices, answers.get(error.option))]
    if error.option in ("columns", "units"):
        text = head_of(file).decode("utf-8", "replace")
        lines = "\n".join(text.splitlines()[:_SHOWN])
    text = str(_by_name(error, files))
    return {"file": file.name, "kind": "machine", "lines": lines, "ask": ask, "text": text}


def _choice(name: str, text: str, choices: list[str] | None, value: str | None) -> Answer:
    return {"name": name, "text": text, "choices": choices, "value": value}


def _asked_for_pads(conversion: Conversion) -> Answer:
    """Return the questions whether tests are of one or several pads, and which is of which."""
    tests, units = conversion.tests, conversion.units
    names = [test.named for test in tests]
    pattern = suggested_pattern(names)
    pads = [pad_in(name, pattern_of(pattern)) if pattern else None for name in names]
    files = list(dict.fromkeys(test.file.name for test in tests))
    more = f" and {len(files) - 1} more hold" if len(files) > 1 else " holds"
    way = "1" if units.dimensionless else units.displacement
    head = ["Test", "Rows", "Duration (s)", f"Largest {units.displacement_name} ({way})",
            f"Largest {units.force_name} ({units.force})"]  # fmt: skip
    rows = [
        [test.test, str(len(test.time)), plain(float(test.time[-1])),
         plain(float(test.displacement.max())), plain(float(test.force.max()))]
        for test in tests
    ]  # fmt: skip
    ask = [_choice(_HOW, "these tests are of", [ONE, SEVERAL], ONE)]
    ask += [
        _choice(_PAD.format(k), test.test, None, pad)
        for k, (test, pad) in enumerate(zip(tests, pads, strict=True))
    ]
    may = "They may be tests of one pad, or of several pads (specimens)."
    text = f"{files[0]}{more} {len(tests)} tests. {may}"
    return {"file": files[0], "kind": _HOW, "rows": [head, *rows], "ask": ask, "text": text}


def _pads_of(answers: dict[str, str]) -> tuple[str, ...]:
    """Return the pads' names that answers state: one, one a test, or none if none is stated."""
    if answers.get(_HOW) == ONE:
        return (DEFAULT_PAD,)
    if answers.get(_HOW) != SEVERAL:
        return ()
    last = max((k for k in range(len(answers)) if _PAD.format(k) in answers), default=-1)
    pads = [answers.get(_PAD.format(k), "").strip() for k in range(last + 1)]
    if "" in pads or not pads:
        what = f"test {pads.index('') + 1 if pads else 1} has no pad"
        raise InputError(what, remedy="name the pad of each test")
    return tuple(pads)


def _by_name(error: InputError, uploads: Sequence[Path]) -> InputError:
    """Return the same error with names of uploads in place of their paths."""

    def named(text: str | None) -> str | None:
        for one in uploads:
            text = text.replace(str(one), one.name) if text else text
        return text

    what, file, remedy = (named(x) for x in (error.message, error.file, error.remedy))
    return InputError(what or "", file=file, line=error.line, remedy=remedy)
