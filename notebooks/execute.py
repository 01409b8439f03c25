"""Execute notebooks in one kernel and keep their outputs: `make notebooks`. Fails if a cell does.

One kernel for all, with its names cleared between notebooks: what has been compiled stays.
"""

import base64
import sys
import time
from collections.abc import Iterator, Sequence
from io import BytesIO
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from PIL import Image

FOLDER = Path(__file__).parent
CLEAR = "%reset -f"
COLOURS = 128  # of a stored picture: a third of the size, and no difference to be seen


def execute(paths: Sequence[Path]) -> Iterator[tuple[Path, nbformat.NotebookNode, float]]:
    """Each notebook with fresh outputs, run from the project's top folder, and its seconds.

    Raises
    ------
    nbclient.exceptions.CellExecutionError
        A cell fails.
    """
    resources = {"metadata": {"path": str(FOLDER.parent)}}
    blank = nbformat.v4.new_notebook()
    client = NotebookClient(blank, timeout=1200, kernel_name="python3", resources=resources)
    with client.setup_kernel(cwd=str(FOLDER.parent)):
        for path in paths:
            begin = time.monotonic()
            notebook = nbformat.read(path, as_version=4)
            _run(client, notebook)
            yield path, notebook, time.monotonic() - begin


def _run(client: NotebookClient, notebook: nbformat.NotebookNode) -> None:
    """Fill in a notebook's outputs; nothing of the one before is left in the kernel."""
    client.nb = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(CLEAR)])
    client.execute_cell(client.nb.cells[0], 0)
    client.nb = notebook
    client.reset_execution_trackers()
    for index, cell in enumerate(notebook.cells):
        client.execute_cell(cell, index, execution_count=client.code_cells_executed + 1)
        cell.metadata.pop("execution", None)
        for output in cell.get("outputs", []):
            if "execution_count" in output:  # the kernel counts on over all notebooks
                output["execution_count"] = cell["execution_count"]


def shrink(notebook: nbformat.NotebookNode) -> None:
    """Store the pictures with a palette."""
    for cell in notebook.cells:
        for output in cell.get("outputs", []):
            data = output.get("data", {})
            if "image/png" in data:
                data["image/png"] = _with_palette(data["image/png"])


def _with_palette(picture: str) -> str:
    small = BytesIO()
    image = Image.open(BytesIO(base64.b64decode(picture))).convert("RGB")
    image.quantize(COLOURS, dither=Image.Dither.NONE).save(small, "png", optimize=True)
    return base64.b64encode(small.getvalue()).decode()


if __name__ == "__main__":
    chosen = [Path(name) for name in sys.argv[1:]] or sorted(FOLDER.glob("*.ipynb"))
    for path, notebook, seconds in execute(chosen):
        print(f"{path.name}: {seconds:.1f} s", file=sys.stderr)
        shrink(notebook)
        nbformat.write(notebook, path)
