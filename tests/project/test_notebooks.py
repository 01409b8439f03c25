"""Every notebook runs as it stands, and its stored outputs are complete and small."""

import importlib.util
import re
from pathlib import Path

import nbformat
import pytest

ROOT = Path(__file__).parents[2]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
LARGEST = 300_000  # bytes
NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w])")
APART = 0.1  # of a number: chains and importance samples differ between processors
SURELY_NOT = 1e-2  # a probability below this is as good as any other


@pytest.fixture(scope="module")
def executed():
    """All notebooks, executed in one kernel; the real material without its file."""
    return run(NOTEBOOKS)


def run(paths):
    """Notebooks by name, executed."""
    spec = importlib.util.spec_from_file_location("execute", ROOT / "notebooks" / "execute.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("QLVBAYES_MUSCLE", str(ROOT / "no_such_file.csv"))
        return {path.stem: notebook for path, notebook, _ in module.execute(paths)}


def printed(notebook):
    """All that a notebook printed."""
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    return "".join(output.text for output in outputs if output.output_type == "stream")


@pytest.mark.slow
def test_every_notebook_runs(executed):
    assert set(executed) == {path.stem for path in NOTEBOOKS}
    for notebook in executed.values():
        cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
        assert all(cell.execution_count for cell in cells)


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS[:4], ids=lambda path: path.stem)
def test_a_fresh_run_prints_what_is_stored(executed, path):
    stored, fresh = printed(nbformat.read(path, as_version=4)), printed(executed[path.stem])
    assert NUMBER.sub("#", " ".join(stored.split())) == NUMBER.sub("#", " ".join(fresh.split()))
    for old, new in zip(NUMBER.findall(stored), NUMBER.findall(fresh), strict=True):
        assert are_close(old, new), f"{old} is stored, {new} found"


def are_close(old, new):
    """Return whether two printed numbers are the same but for sampling and rounding."""
    one, two = float(old), float(new)
    digit = 10.0 ** -len(old.partition("e")[0].partition(".")[2])
    both = max(abs(one), abs(two))
    return abs(one - two) <= max(2.0 * digit, APART * both) or both < SURELY_NOT


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_stored_outputs_are_complete_and_small(path):
    assert path.stat().st_size < LARGEST
    cells = [c for c in nbformat.read(path, as_version=4).cells if c.cell_type == "code"]
    assert all(cell.execution_count for cell in cells)
    assert not [o for c in cells for o in c.outputs if o.output_type == "error"]
