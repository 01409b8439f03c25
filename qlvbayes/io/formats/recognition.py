"""Recognise the layout of a file from its first bytes, or name the nearest layout."""

from __future__ import annotations

import gzip
import re
import zlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from qlvbayes.io.checks import InputError
from qlvbayes.io.formats.columns import (
    in_cells,
    measured,
    plain_name,
    quantities,
)
from qlvbayes.io.formats.format import HEAD, Format, Sight, unsure_of_columns
from qlvbayes.io.formats.layouts import columns_in
from qlvbayes.io.formats.machineunits import unit_of
from qlvbayes.io.formats.textfile import (
    Lines,
    content,
    decoded,
    is_like_number,
    is_text,
    refuse_cells,
    separator_of,
    with_tabs,
)
from qlvbayes.io.formats.texttable import refuse_unknown_units
from qlvbayes.io.reading.csvtext import cut_gzip, unreadable
from qlvbayes.io.reading.dialect import sniff
from qlvbayes.io.reading.header import is_tidy_name
from qlvbayes.io.wording import joined

_SHOWN = 200  # characters of a file's own names that an error shows
_COUNTER = re.compile(r"(index|nr|no|s no|row|sample|point|punkt|zeile)?")
_LACKED = {"strain": "displacement (or strain)", "stress": "force (or stress)"}
_LEAST = 10  # rows that show whether a column rises
_NEAR = 0.5  # share of its marks that a layout must show to be reported as the nearest


def head_of(path: Path) -> bytes:
    """Return the first bytes of a file, unzipped."""
    try:
        with path.open("rb") as stream:
            zipped = stream.read(2) == b"\x1f\x8b"
        if not zipped:
            with path.open("rb") as stream:
                return stream.read(HEAD)
        with gzip.open(path, "rb") as stream:
            return stream.read(HEAD)
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise cut_gzip(path) from error
    except OSError as error:
        raise unreadable(path, error) from error


def matching(head: bytes, kinds: Sequence[Format]) -> tuple[list[Format], Format | None, Sight]:
    """Return the formats whose marks are all there, the nearest other one, and what it shows."""
    sights = {kind: kind.sniff(head) for kind in kinds}
    fitting = [kind for kind, sight in sights.items() if sight.whole]
    whole = [kind for kind in fitting if not kind.general] or fitting
    others = [kind for kind in kinds if kind not in fitting and sights[kind].share >= _NEAR]
    nearest = max(others, key=lambda kind: sights[kind].share, default=None)
    return whole, nearest, Sight((), ()) if nearest is None else sights[nearest]


def recognised(path: Path, kinds: Sequence[Format]) -> Format:
    """Return the one format of a file."""
    head = head_of(path)
    if not head.strip(b"\0 \t\r\n"):
        raise InputError("the file is empty", file=path, remedy="export the measurements again")
    whole, nearest, sight = matching(head, kinds)
    if len(whole) == 1:
        return whole[0]
    if _is_tidy(head):
        raise InputError(
            "the file is tidy already",
            file=path,
            remedy="give it to fit, diagnose or study, or state --columns to convert it anew",
        )
    if whole:
        names = joined([kind.name for kind in whole])
        raise InputError(
            f"the layouts {names} all fit", file=path, remedy="export it in another way"
        )
    _refuse_by_content(head, path)
    if nearest is None:
        raise InputError(
            "no known layout",
            file=path,
            remedy="export CSV with time_s, displacement_mm, force_N, state --columns, or describe "
            "the layout with --formats-file",
        )
    raise InputError(
        f"no known layout; the nearest is {nearest.name}, which shows {joined(list(sight.found))} "
        f"but not {joined(list(sight.missing))}",
        file=path,
        remedy="export it again, state --columns, or describe the layout with --formats-file",
    )


def _refuse_by_content(head: bytes, path: Path) -> None:
    """Raise the error, or the question, of what an unknown layout shows that it holds."""
    if not is_text(head):
        return
    refuse_results(head, path)
    refuse_unknown_units(Lines.from_bytes(decoded(head).encode()), path)
    if any(map(is_tidy_name, _first_names(head))):
        sniff(path)  # its error says which column is to be renamed
    lines = Lines.from_bytes(with_tabs(decoded(head).encode())[0])
    headers = [(number, cells, measured(in_cells(cells))) for number, cells in lines.cells()]
    for number, cells, by_quantity in headers:
        picked = [named.index for named in by_quantity.values() if named]
        others = [cell for index, cell in enumerate(cells) if index not in picked]
        lacking = [quantity for quantity, named in by_quantity.items() if named is None]
        if len(lacking) == 1 and all(_COUNTER.fullmatch(plain_name(cell)) for cell in others):
            lost = _LACKED.get(lacking[0], lacking[0])
            what = f"there is no column of {lost} (the file has: {', '.join(cells)[:_SHOWN]})"
            remedy = f"export the {lost} of every sample"
            raise InputError(what, file=path, line=number + 1, remedy=remedy)
    if names := columns_in(lines):
        refuse_timeless(with_tabs(content(path))[0], path)
        raise unsure_of_columns(names, path)
    for _, _, by_quantity in headers:
        if all(by_quantity.values()):
            refuse_cells(lines, [named.index for named in by_quantity.values() if named], path)


_RISES = 0.8  # share of a column's rows that rise from the row before, at least, where it is a time
_LOOKED_AT = 20_000  # rows


def refuse_timeless(data: bytes, path: Path) -> None:
    """Raise InputError where no column of a table rises from row to row, as a time does."""
    lines = Lines.from_bytes(data)
    table = [(n, cells) for n, cells in lines.cells() if len(cells) > 2]
    first = next((n for n, cells in table if all(map(is_like_number, cells))), None)
    if first is None:
        return
    separator = separator_of(lines.texts[first])
    rows = data[lines.starts[first] :].decode("utf-8", "replace").split("\n", _LOOKED_AT)
    cells = [row.split(separator) for row in rows[:_LOOKED_AT] if row.strip()]
    width = len(cells[0])
    numbers = np.array([[_number(cell) for cell in row] for row in cells if len(row) == width])
    steps = np.diff(numbers, axis=0)
    rising = np.count_nonzero(steps > 0.0, axis=0) >= _RISES * len(steps)
    named = columns_in(lines)
    other = np.array([_has_other_unit(name) for name in named][:width])
    if len(other) == width:
        rising &= ~other
    if len(steps) > _LEAST and np.isfinite(numbers).all() and not rising.any():
        raise InputError(
            "there is no time: no column rises from row to row as one does (the file has: "
            f"{', '.join(named)[:_SHOWN]})",
            file=path,
            line=first + 1,
            remedy="export the time of every sample",
        )


def _has_other_unit(name: str) -> bool:
    """Return whether a name has a unit of displacement or force as one of its words."""
    words = re.split(r"[\s_,/()\[\]]+", name)
    kinds = ("displacement", "force", "stress")
    return any(unit_of(word, kind) for word in words if word for kind in kinds)


def _number(text: str) -> float:
    try:
        return float(text.strip(' "').replace(",", "."))
    except ValueError:
        return 0.0 if ":" not in text else float("nan")  # a time of hh:mm:ss may be one


_RESULTS = {
    "a relaxation modulus": (
        r"[gek]( ?t| relax\w*)|relaxation modulus|relaxationsmodul|module de relaxation"
        r"|modulo di rilassamento|modulo de (relajacion|relaxacion)"
    ),
    "a creep compliance": (
        r"j( ?t| creep)?|(creep |kriech)?(compliance|nachgiebigkeit)|complaisance( en fluage)?"
        r"|cedevolezza( a creep)?|(complianza|compliancia)( de fluencia)?"
    ),
    "storage and loss moduli": (
        r"(storage|loss|complex|dynamic) modulus|(speicher|verlust)modul"
        r"|module (de conservation|de perte|complexe)|modulo (conservativo|dissipativo)"
        r"|modulo de (almacenamiento|perdida)"
    ),
}
"""Quantities that some programs compute from measurements, with the simplified column names."""
_OVER = {
    "a relaxation modulus": "strain and stress over time",
    "a creep compliance": "strain and stress over time",
    "storage and loss moduli": "strain and stress over time, of the oscillations themselves",
}
_HEADER = 60  # lines among which the names of columns are
_UNIT = re.compile(r"\s*[\[(][^\[\]()]{2,}[\])]$|[_ ](1/)?[kMG]?Pa$")  # (t) of G(t) is no unit


def refuse_results(head: bytes, path: Path) -> None:
    """Raise InputError where a table holds moduli or compliances in place of measurements."""
    for number, cells in Lines.from_bytes(decoded(head).encode()).cells():
        if number > _HEADER:
            return
        if len(cells) < 2 or {"force", "stress"} & set(quantities(in_cells(cells))):
            continue
        for cell in cells:
            plain = plain_name(_UNIT.sub("", cell))
            for what, words in _RESULTS.items():
                if re.fullmatch(words, plain):
                    raise InputError(
                        f"'{cell}' is {what}: the file has no displacement (or strain) and no "
                        "force (or stress) of a test, which this program fits",
                        file=path,
                        remedy=f"export the readings, {_OVER[what]}",
                    )


_MEASURED = (("displacement", "force"), ("strain", "stress"))


def _is_tidy(head: bytes) -> bool:
    """Return whether the first line that is no comment names the columns of a tidy file."""
    columns = {name.partition("_")[0] for name in _first_names(head)}
    return "time" in columns and any(columns.issuperset(pair) for pair in _MEASURED)


def _first_names(head: bytes) -> set[str]:
    """Return the cells of the first line that is no comment."""
    lines = head.decode("utf-8-sig", "replace").splitlines()
    rows = (line for line in lines if line.strip() and not line.startswith(("#", "sep=")))
    return {name.strip(' "') for name in re.split("[,;\t]", next(rows, ""))}
