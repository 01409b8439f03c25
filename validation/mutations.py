"""Damages files at random: what a transfer, an editor or an unknown machine may make of them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

Rng = np.random.Generator

_NUMBERS = (
    b"nan", b"inf", b"-inf", b"1e400", b"-1e308", b"0", b"-0.0", b"1e-320", b"-999", b"9.99e37",
    b"1,5", b"1.2.3", b"0x1F", b"1_000", b"", b"--", b"1e", b"99999999999999999999999999999999",
)  # fmt: skip
_TEXTS = (
    b"\x00", b"\xff\xfe", b"\xef\xbb\xbf", b"\r", b"\n\n", b"\t", b'"', b'""', b"'", b";", b",",
    b"#", b"=1+1", b"<script>", b"$5_{$", b"[/]", b"../../", b"\\input{x}", "µ".encode(),
    "µ".encode("cp1252"), "время".encode(), b"\x1b[2J", b"A" * 10_000,
)  # fmt: skip
_LONGEST = 4_000_000
"""Bytes: a mutation never makes a file larger than this, so that size alone is not what is slow."""


def mutated(data: bytes, rng: Rng) -> bytes:
    """Return the data after one to four random changes, in bytes and in lines."""
    for _ in range(int(rng.integers(1, 5))):
        change = CHANGES[int(rng.integers(len(CHANGES)))]
        data = change(data, rng)[:_LONGEST]
    return data


def _place(data: bytes, rng: Rng) -> int:
    """Return an index into the data, half of the time into its first 512 bytes: the header."""
    size = len(data) if rng.random() < 0.5 else min(len(data), 512)
    return int(rng.integers(size + 1))


def _flip(data: bytes, rng: Rng) -> bytes:
    changed = bytearray(data)
    for _ in range(int(rng.integers(1, 9))):
        if changed:
            changed[min(_place(data, rng), len(changed) - 1)] = int(rng.integers(256))
    return bytes(changed)


def _truncate(data: bytes, rng: Rng) -> bytes:
    return data[: _place(data, rng)]


def _delete(data: bytes, rng: Rng) -> bytes:
    start = _place(data, rng)
    return data[:start] + data[start + int(rng.integers(1, 200)) :]


def _repeat(data: bytes, rng: Rng) -> bytes:
    start = _place(data, rng)
    part = data[start : start + int(rng.integers(1, 200))]
    return data[:start] + part * int(rng.integers(2, 50)) + data[start:]


def _insert(data: bytes, rng: Rng) -> bytes:
    start = _place(data, rng)
    return data[:start] + _TEXTS[int(rng.integers(len(_TEXTS)))] + data[start:]


def _number(data: bytes, rng: Rng) -> bytes:
    """Replace what stands between two separators."""
    start = _place(data, rng)
    ends = [at for mark in b",;\t \n" if (at := data.find(mark, start)) >= 0]
    if not ends:
        return data
    begin = min(ends) + 1
    stops = [at for mark in b",;\t \r\n" if (at := data.find(mark, begin)) >= 0]
    stop = min(stops, default=len(data))
    return data[:begin] + _NUMBERS[int(rng.integers(len(_NUMBERS)))] + data[stop:]


def _swap_lines(data: bytes, rng: Rng) -> bytes:
    lines = data.split(b"\n")
    one, two = rng.integers(len(lines), size=2).tolist()
    lines[one], lines[two] = lines[two], lines[one]
    return b"\n".join(lines)


def _drop_line(data: bytes, rng: Rng) -> bytes:
    lines = data.split(b"\n")
    at = int(rng.integers(len(lines))) if rng.random() < 0.5 else int(rng.integers(6))
    return b"\n".join(lines[:at] + lines[at + 1 :])


def _repeat_line(data: bytes, rng: Rng) -> bytes:
    lines = data.split(b"\n")
    at = int(rng.integers(len(lines)))
    return b"\n".join(lines[:at] + [lines[at]] * int(rng.integers(2, 400)) + lines[at + 1 :])


def _other_separator(data: bytes, rng: Rng) -> bytes:
    marks = (b",", b";", b"\t", b" ", b"|", b"\r\n", b"\n", b"\r", b".")
    old, new = (marks[k] for k in rng.integers(len(marks), size=2).tolist())
    return data.replace(old, new)


def _one_constant_column(data: bytes, rng: Rng) -> bytes:
    """Write one number into a column of every row, as a dead channel does."""
    mark = (b",", b";", b"\t")[int(rng.integers(3))]
    column, value = int(rng.integers(4)), _NUMBERS[int(rng.integers(len(_NUMBERS)))]
    lines = []
    for k, line in enumerate(data.split(b"\n")):
        cells = line.split(mark)
        if k > 8 and len(cells) > column:
            cells[column] = value
        lines.append(mark.join(cells))
    return b"\n".join(lines)


def _doubled(data: bytes, rng: Rng) -> bytes:
    return data + data


CHANGES: tuple[Callable[[bytes, Rng], bytes], ...] = (
    _flip, _truncate, _delete, _repeat, _insert, _number, _number, _swap_lines, _drop_line,
    _repeat_line, _other_separator, _one_constant_column, _doubled,
)  # fmt: skip
