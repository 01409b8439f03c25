"""Files as machines write them: one simulated test in every layout, stored in tests/corpus."""

import csv
import io
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

CORPUS = Path(__file__).parents[1] / "corpus"
LAG = 0.0042  # s, by which the force's clock is behind in the files of two clocks


@dataclass(frozen=True, eq=False)
class Pressed:
    """A test with its approach: time (s), displacement (mm, zero at contact), force (N)."""

    time: np.ndarray
    way: np.ndarray
    load: np.ndarray


def pressed(approach=0.4, depth=1.2, speed=2.0, hold=2.0, rate=200.0, seed=1, noise=0.002):
    """A pad of exponential law and one relaxation mode, approached and pressed, then held."""
    m, b, c, v = 0.4, 1.1, 0.6, 3.0
    ramp = (approach + depth) / speed
    time = np.arange(int(rate * (ramp + hold))) / rate
    way = np.minimum(time * speed - approach, depth)
    touched = np.maximum(way, 0.0)
    elastic = m / b * np.expm1(b * touched)
    q, load = 0.0, []
    for k, step in enumerate(np.diff(elastic, prepend=0.0)):
        q = (q + step) * np.exp(-v / rate) if k else 0.0
        load.append((1.0 - c) * elastic[k] + c * q)
    rng = np.random.default_rng(seed)
    return Pressed(time, way, np.array(load) + rng.normal(0.0, noise, len(time)))


STORED = pressed(hold=0.6)
"""The test that the files of the corpus hold."""


@dataclass(frozen=True)
class Fixture:
    """A layout's file: the signs of displacement and force as written, and how many tests."""

    format: str
    path: Path
    signs: tuple[int, int]
    tests: int
    needs: str  # a package to read it

    def content(self):
        """The bytes of the file; the test is skipped without the package that reads them."""
        if self.needs and find_spec(self.needs) is None:
            pytest.skip(f"{self.needs} is not installed")
        return self.path.read_bytes()

    def written(self, folder):
        """A copy in a folder, to be damaged."""
        path = folder / self.path.name
        path.write_bytes(self.content())
        return path


def _fixtures():
    folder = CORPUS / "machines"
    with (folder / "manifest.csv").open() as file:
        for row in csv.DictReader(file):
            signs = int(row["way"]), int(row["load"])
            yield Fixture(
                row["format"], folder / row["file"], signs, int(row["tests"]), row["needs"]
            )


FIXTURES = tuple(_fixtures())


def refusals(name):
    """Stored refusals: who refuses, what was given, a word of what is said."""
    with (CORPUS / f"{name}.tsv").open(encoding="utf-8", newline="") as file:
        _, *rows = csv.reader(file, delimiter="\t", quoting=csv.QUOTE_NONE)
    return rows


def of_layout(name):
    """The path of a stored file of a layout, as 'bluehill-3-a.csv'."""
    return CORPUS / "machines" / name


def bluehill(test, names="Time,Extension,Load", units="(s),(mm),(N)", zero=0.0):
    """A test as Bluehill writes it."""
    rows = zip(test.time, test.way + zero, test.load, strict=True)
    return f"{names}\n{units}\n" + "".join(f"{t:.5f},{d:.6f},{f:.6f}\n" for t, d, f in rows)


def workbook(path, titles, above=(), form=()):
    """A French workbook of testXpert: a sheet with a test for each title, and one of keys."""
    import openpyxl

    book = openpyxl.Workbook()
    book.remove(book.active)
    head = [["Temps d'essai", "Allongement", "Force standard"], ["s", "mm", "N"]]
    for seed, title in enumerate(titles):
        sheet, test = book.create_sheet(title), pressed(seed=seed)
        table = np.stack([test.time, test.way, test.load], axis=1).tolist()
        for row in [[above or title], *head, *table]:
            sheet.append(row)
    for row in form:
        (book["form"] if "form" in book.sheetnames else book.create_sheet("form")).append(row)
    out = io.BytesIO()
    book.save(out)
    path.write_bytes(out.getvalue())
    return path
