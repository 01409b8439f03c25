"""Make frozen records and the JSON files that hold them, each from the other.

msgspec reads and checks them: it refuses a wrong type and names its location in the file. Keys of
the file that differ from the attribute's name are listed at the record's class, in ``rename``.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, ClassVar, Self

import msgspec
import numpy as np

from qlvbayes.io.checks import InputError
from qlvbayes.io.files import write_whole


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
