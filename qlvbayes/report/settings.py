"""The settings of a diagnosis in the field's words, one a row."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from typing import get_type_hints

from qlvbayes.diagnosis.settings import DiagnosisSettings


def settings_rows(settings: DiagnosisSettings) -> list[tuple[str, str]]:
    """Return each setting in words with its value."""
    return [(words, f"{value:g}") for _, words, value in in_words(settings)]


def in_words(settings: object) -> Iterator[tuple[str, str, float]]:
    """Yield the name of each setting, those of a part as ``breadth.beam``, its words and value."""
    assert is_dataclass(settings)
    hints = get_type_hints(type(settings), include_extras=True)
    for field in fields(settings):
        value = getattr(settings, field.name)
        if is_dataclass(value):
            for name, words, number in in_words(value):
                yield f"{field.name}.{name}", words, number
        else:
            (words,) = hints[field.name].__metadata__
            yield field.name, words, value
