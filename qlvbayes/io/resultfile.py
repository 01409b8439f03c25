"""Results as types: a frozen record and the JSON file that holds it, each made of the other.

msgspec reads and checks them: one wheel of half a megabyte that needs nothing else. It refuses a
wrong type by its place in the file, where own code would be as long as this again and cattrs, which
needs attrs too, would turn what is wrong into something else. Keys of the file that are no
attribute's name stand beside the record's class, in ``rename``.
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
    """A record inside a result."""


class Result(Part, frozen=True, kw_only=True, tag_field="schema", tag=1):
    """A record that is a file of its own; the file's key ``schema`` is the version of its keys.

    Keys that are not known are passed over, so that a later version may add some.
    """

    indent: ClassVar[int | None] = 2

    def to_json(self) -> str:
        """The file's text. Raises ValueError where a number is not finite."""
        content = msgspec.to_builtins(self, enc_hook=_plain)
        return json.dumps(content, indent=self.indent, allow_nan=False) + "\n"

    def as_dict(self) -> dict[str, Any]:
        """The file's content as plain Python."""
        return dict(json.loads(self.to_json()))

    @classmethod
    def from_json(cls, text: str | bytes, *, file: str | Path | None = None) -> Self:
        """The record of which the text was made.

        file: named in errors. Raises InputError where the text is cut, a key is missing or of the
        wrong type, or the schema is a newer one.
        """
        try:
            return msgspec.json.decode(text, type=cls)
        except (msgspec.MsgspecError, InputError, UnicodeDecodeError) as error:
            known, found = cls.__struct_config__.tag, _schema(text)
            if isinstance(known, int) and isinstance(found, int) and found > known:
                raise InputError(
                    f"written by a newer version of qlvbayes (schema {found}, known is {known})",
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
        """Read a file; InputError as in `from_json`, OSError where it cannot be opened."""
        return cls.from_json(Path(path).read_bytes(), file=path)


def _plain(value: object) -> object:
    """Numbers of numpy, which msgspec does not know."""
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"a result cannot hold {type(value).__name__}")


def _schema(text: str | bytes) -> object:
    """What a file that is refused says of its schema."""
    try:
        found = msgspec.json.decode(text)
    except (msgspec.MsgspecError, UnicodeDecodeError):
        return None
    return found.get("schema") if isinstance(found, dict) else None
