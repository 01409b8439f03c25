"""One result for all processes of a run: the first that asks makes it, the others read it."""

import fcntl
import hashlib
import pickle
from pathlib import Path

FOLDER: Path | None = None  # of the run, set by tests/conftest.py where it has several processes


def once(make, *of):
    """Return what ``make`` gives; ``of`` tells it from other results by its ``repr``."""
    if FOLDER is None:
        return make()
    file = FOLDER / f"once-{hashlib.sha256(repr(of).encode()).hexdigest()}"
    with file.with_suffix(".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not file.exists():
            file.write_bytes(pickle.dumps(make()))
    return pickle.loads(file.read_bytes())
