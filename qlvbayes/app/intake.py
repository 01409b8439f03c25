"""Convert uploaded files to one tidy file in a session's folder, or to questions.

Nothing in a file is executed, and no name in it becomes a path.
"""

from __future__ import annotations

import csv
import io
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from qlvbayes.app import columns, specimens
from qlvbayes.app.sessions import ASKED, DATA
from qlvbayes.io.checks import InputError
from qlvbayes.io.data import Measurements, read_measurements
from qlvbayes.io.files import results_folder, write_whole
from qlvbayes.io.formats.answers import SIGNS, Answers, UnsureError
from qlvbayes.io.formats.catalogue import FORMATS
from qlvbayes.io.formats.conversion import convert, in_short
from qlvbayes.io.formats.recognition import head_of, matching
from qlvbayes.io.formats.tidy import write_tidy
from qlvbayes.io.reading.dialect import sniff
from qlvbayes.io.units import column_name

Answer = dict[str, Any]


def read_in(folder: Path, uploads: Sequence[Path], answers: dict[str, str]) -> Answer:
    """Return the tidy file's path as ``data``, or ``questions``."""
    try:
        return _read_in(results_folder(folder), uploads, answers)
    except InputError as error:
        raise _by_name(error, uploads) from error


def _read_in(folder: Path, uploads: Sequence[Path], answers: dict[str, str]) -> Answer:
    if len(uploads) == 1 and _is_tidy(uploads[0]):
        return _kept(folder, uploads[0])
    if all(_is_machine(one) for one in uploads):
        return _converted(folder, uploads, answers)
    if len(uploads) == 1:
        return _described(folder, uploads[0], answers)
    studies = [read_measurements(one) for one in uploads]
    write_whole(folder / DATA, _joined(studies))
    return {"data": str(folder / DATA)}


def _is_tidy(file: Path) -> bool:
    try:
        sniff(file)
    except InputError:
        return False
    return True


def _is_machine(file: Path) -> bool:
    """Return whether exactly one known layout fits; a tidy file has none."""
    return not _is_tidy(file) and len(matching(head_of(file), FORMATS)[0]) == 1


def _kept(folder: Path, file: Path) -> Answer:
    """Copy a tidy file as it is, once it has been read without an error."""
    read_measurements(file)
    target = folder / (f"{DATA}.gz" if file.suffix.lower() == ".gz" else DATA)
    if not (target.is_file() and target.samefile(file)):
        shutil.copyfile(file, target)
    return {"data": str(target)}


def _converted(folder: Path, files: Sequence[Path], answers: dict[str, str]) -> Answer:
    """Convert machine files to a tidy file, or return the one question that they leave open."""
    chosen = {name: answers[name] for name in ASKED if answers.get(name)}
    pads = specimens.pads_of(answers)
    stated = Answers.from_words(
        chosen.get("sign"),
        chosen.get("contact"),
        chosen.get("units"),
        _number(chosen.get("area")),
        pads,
    )
    try:
        conversion = convert(files, stated)
    except UnsureError as error:
        if error.option in ("units", "columns") and len(files) == 1 and columns.is_table(files[0]):
            return _described(folder, files[0], answers)
        choices = list(SIGNS) if error.option == "sign" else None
        ask: Answer = {"name": error.option, "text": error.question, "choices": choices}
        ask |= {"value": answers.get(error.option), "optional": False}
        name = Path(error.file or files[0]).name
        text = str(_by_name(error, files))
        questions = {"file": name, "kind": "machine", "rows": [], "ask": [ask], "text": text}
        return {"questions": questions}
    if conversion.undivided:
        return {"questions": specimens.asked(conversion)}
    write_tidy(conversion, folder / DATA)
    options = {**chosen, **({"pad": ",".join(pads)} if pads else {})}
    made = {"files": [file.name for file in files], "options": options}
    return {"data": str(folder / DATA), "notices": in_short(conversion.notices), "made": made}


def _described(folder: Path, file: Path, answers: dict[str, str]) -> Answer:
    """Convert a table of unknown columns or units, once the user has stated them."""
    if "time" not in answers:
        return {"questions": columns.asked(file)}
    described = folder / DATA
    write_whole(described, columns.renamed(file, answers))
    try:
        read_measurements(described)
    except InputError as error:
        described.unlink()
        raise InputError(error.message, file=file, line=error.line, remedy=error.remedy) from error
    return {"data": str(described)}


def _number(text: str | None) -> float | None:
    try:
        return float(text) if text else None
    except ValueError:
        raise InputError(f"{text!r} is no number", remedy="give the area in mm2") from None


def _joined(studies: Sequence[Measurements]) -> bytes:
    """Return several tidy files as one; a test whose name is taken is prefixed with its file's."""
    units = studies[0].units
    displacement = column_name(
        units.displacement_name, "" if units.dimensionless else units.displacement
    )
    out = io.StringIO()
    table = csv.writer(out, lineterminator="\n")
    force = column_name(units.force_name, units.force)
    table.writerow(["pad", "test", "start_s", "time_s", displacement, force])
    taken: set[tuple[str, str]] = set()
    for study in studies:
        if study.units != units:
            raise InputError(
                "this file has other units than the first",
                file=study.source,
                remedy="open it by itself",
            )
        for pad in study.pads:
            for test in pad.tests:
                name = test.name
                if (pad.name, name) in taken:
                    name = f"{Path(study.source).stem} {name}"
                taken.add((pad.name, name))
                start = f"{test.start_s:.9g}" if test.start_known else ""
                rows = zip(
                    test.time.tolist(), test.displacement.tolist(), test.force.tolist(), strict=True
                )
                table.writerows([pad.name, name, start, *map(repr, row)] for row in rows)
    return out.getvalue().encode()


def _by_name(error: InputError, uploads: Sequence[Path]) -> InputError:
    """Return the same error with names of uploads in place of their paths."""

    def plain(text: str | None) -> str | None:
        for one in uploads:
            text = text.replace(str(one), one.name) if text else text
        return text

    return InputError(
        plain(error.message) or "",
        file=plain(error.file),
        line=error.line,
        remedy=plain(error.remedy),
    )
