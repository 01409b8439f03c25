"""List the keys of a file of results from its record's types and what its source says of them."""

from __future__ import annotations

import inspect
import re
import types
import typing
from collections.abc import Iterator
from typing import Any

import msgspec

_PLAIN = {str: "text", float: "number", int: "integer", bool: "true or false"}
# "name, other: words; third: words", and numpydoc's names on lines of their own
_NAMED = re.compile(r"(?:^|(?<=[;.]) )((?:\w+, )*\w+): (.*?)(?=; (?:\w+, )*\w+: |$)")
_DEEPEST = 3  # levels of records that a table shows


def record(kind: Any, before: str = "", level: int = 1) -> Iterator[tuple[str, str, str]]:
    """Yield key, type and meaning of each field, and of the records within them."""
    hints, words = typing.get_type_hints(kind), meanings(kind)
    for field in msgspec.structs.fields(kind):
        parts, inner = _unwrapped(hints[field.name])
        key = before + field.encode_name
        yield f"`{key}`", parts, words.get(field.name, "").replace("None", "null")
        if inner is not None and level < _DEEPEST:
            mark = "[]" if "list" in parts else ".*" if "by name" in parts else ""
            yield from record(inner, f"{key}{mark}.", level + 1)


def _unwrapped(hint: Any) -> tuple[str, Any]:
    """Return a type in words, and the record within it if there is one."""
    if typing.get_origin(hint) is typing.Annotated:
        return _unwrapped(hint.__origin__)
    origin, inner = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        some = [one for one in inner if one is not types.NoneType]
        words, found = _unwrapped(some[0])
        return (f"{words} or null" if len(some) < len(inner) else words), found
    if origin is typing.Literal:
        return " or ".join(f"`{one}`" for one in inner), None
    if origin is tuple:
        words, found = _unwrapped(inner[0])
        several = words.removesuffix("s") + "s" if words in ("record", "number") else words
        return f"list of {several}", found
    if origin is dict:
        words, found = _unwrapped(inner[1])
        return f"{words} by name", found
    if isinstance(hint, type) and issubclass(hint, str):
        return "text", None
    is_record = isinstance(hint, type) and issubclass(hint, msgspec.Struct)
    return _PLAIN.get(hint, "record"), hint if is_record else None


def meanings(kind: Any) -> dict[str, str]:
    """Return what the docstrings and comments of a record and its bases say of each field."""
    found: dict[str, str] = {}
    for one in reversed(kind.__mro__):
        if one is not msgspec.Struct and issubclass(one, msgspec.Struct):
            found |= _of_comments(one) | _of_docstring(inspect.getdoc(one) or "")
    return found


def _of_docstring(text: str) -> dict[str, str]:
    head, _, listed = text.partition("Parameters\n----------\n")
    pairs = re.findall(r"^(\w[\w, ]*)\n((?:    .*\n?)+)", listed, re.MULTILINE)
    rest = " ".join(head.partition("\n\n")[2].split())
    pairs += _NAMED.findall(rest) if not listed else []
    return {
        name: " ".join(words.split()).rstrip(".").replace("``", "`")
        for names, words in pairs
        for name in names.split(", ")
    }


def _of_comments(kind: Any) -> dict[str, str]:
    """Return what comments say of fields: behind them, or in the lines above the first of some."""
    found, above = {}, list[str]()
    for line in inspect.getsource(kind).splitlines():
        if match := re.match(r"    # (.*)$", line):
            above.append(match[1])
        elif match := re.match(r"    (\w+): [^#]*?(?:  # (.*))?$", line):
            words = match[2] or " ".join(above)
            several = re.match(r"(\w+(?:, \w+)*): (.*)", words)
            named = several is not None and match[1] in several[1].split(", ")
            for name in several[1].split(", ") if several and named else [match[1]]:
                text = several[2] if several and named else words
                found |= {name: text.replace("``", "`")} if text else {}
            above = []
        else:
            above = []
    return found
