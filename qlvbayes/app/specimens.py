"""Ask which test is of which pad, where a machine's file holds several tests."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from typing import Any

from qlvbayes.io.checks import InputError
from qlvbayes.io.formats.conversion import Conversion
from qlvbayes.io.formats.naming import DEFAULT_PAD, pad_in, pattern_of, suggested_pattern
from qlvbayes.io.wording import plain

HOW = "specimens"  # the answer that says whether the tests are of ``ONE`` pad or of ``SEVERAL``
ONE, SEVERAL = "one", "several"
_PAD = "pad{}"  # the answer that names the pad of a test, by the test's number
_SEARCH = "import json, re, sys; p, names = json.load(sys.stdin); [re.search(p, n) for n in names]"
_SHOWN = 200  # characters of a pattern that an error shows
_PATIENCE = 5.0  # s in which a pattern is looked for in all names; a sound one takes milliseconds


def asked(conversion: Conversion) -> dict[str, Any]:
    """Return the questions: one or several pads, and the name of each test's pad."""
    tests, units = conversion.tests, conversion.units
    names = [test.named for test in tests]
    pattern = suggested_pattern(names)
    compiled = pattern_of(pattern)
    pads = [pad_in(name, compiled) if pattern else None for name in names]
    files = list(dict.fromkeys(test.file.name for test in tests))
    more = f" and {len(files) - 1} more" if len(files) > 1 else ""
    way = "1" if units.dimensionless else units.displacement
    head = [
        "Test", "Rows", "Duration (s)", f"Largest {units.displacement_name} ({way})",
        f"Largest {units.force_name} ({units.force})",
    ]  # fmt: skip
    rows = [
        [
            test.test, str(len(test.time)), plain(float(test.time[-1])),
            plain(float(test.displacement.max())), plain(float(test.force.max())),
        ]
        for test in tests
    ]  # fmt: skip
    ask: list[dict[str, Any]] = [
        {"name": HOW, "text": "these tests are of", "choices": [ONE, SEVERAL], "value": ONE,
         "optional": False}
    ]  # fmt: skip
    ask += [
        {"name": _PAD.format(k), "text": test.test, "choices": None, "value": pad, "optional": True}
        for k, (test, pad) in enumerate(zip(tests, pads, strict=True))
    ]
    text = (
        f"{files[0]}{more} {'hold' if more else 'holds'} {len(tests)} tests. "
        "They may be tests of one pad, or of several pads (specimens)."
    )
    questions = {"file": files[0], "kind": HOW, "rows": [head, *rows], "ask": ask, "text": text}
    return questions | {"names": names, "pad_from": pattern}


def pads_by(names: Sequence[str], text: str) -> list[str]:
    """Return the pads that a pattern finds in the names of tests."""
    pattern = pattern_of(text)
    task = json.dumps([text, list(names)]).encode()
    try:
        subprocess.run(
            [sys.executable, "-I", "-S", "-c", _SEARCH],
            input=task, capture_output=True, timeout=_PATIENCE,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        raise InputError(
            f"the pattern '{text[:_SHOWN]}' takes too long on these names",
            remedy="write it without a repetition within another one, as in (a+)+",
        ) from None
    return [pad_in(name, pattern) for name in names]


def pads_of(answers: dict[str, str]) -> tuple[str, ...]:
    """Return the pads' names that answers state: one, one a test, or none if none is stated."""
    if answers.get(HOW) == ONE:
        return (DEFAULT_PAD,)
    if answers.get(HOW) != SEVERAL:
        return ()
    last = max((k for k in range(len(answers)) if _PAD.format(k) in answers), default=-1)
    pads = [answers.get(_PAD.format(k), "").strip() for k in range(last + 1)]
    if "" in pads or not pads:
        raise InputError(
            f"test {pads.index('') + 1 if pads else 1} has no pad",
            remedy="name the pad of each test",
        )
    return tuple(pads)
