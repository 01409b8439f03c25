"""Sound binary files are read in this process, where a test is not of the process apart."""

import pytest

from qlvbayes.io import apart, binary


def read_here(kind, path, *_):
    """As `apart.read_apart`, whose process takes a second to begin."""
    try:
        return apart._READERS[kind](str(path))
    except Exception as error:
        raise apart.ApartError(f"{type(error).__name__}: {error}") from error


@pytest.fixture
def in_this_process(monkeypatch):
    monkeypatch.setattr(binary, "read_apart", read_here)
