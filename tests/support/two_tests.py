"""A small file of measurements: the hidden case, two of its tests."""

import csv
from pathlib import Path

HIDDEN = Path(__file__).parents[2] / "data" / "hidden.csv"
TESTS = ("C-1", "C-100")  # slow and fast: enough to show a drag


def two_tests(path):
    """Write it."""
    with HIDDEN.open() as source, path.open("w", newline="") as sink:
        rows = csv.reader(line for line in source if not line.startswith("#"))
        csv.writer(sink).writerows(r for k, r in enumerate(rows) if k == 0 or r[1] in TESTS)
    return path
