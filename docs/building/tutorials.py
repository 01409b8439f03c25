"""Convert a notebook, with the outputs that it holds, to a page of Markdown and its pictures."""

from __future__ import annotations

from pathlib import Path

import nbformat
from nbconvert import MarkdownExporter


def converted(path: Path) -> tuple[str, dict[str, bytes]]:
    """Return the text, and the pictures by name; nothing is executed."""
    notebook = nbformat.read(path, as_version=4)
    resources = {"unique_key": path.stem, "output_files_dir": f"{path.stem}_files"}
    text, found = MarkdownExporter().from_notebook_node(notebook, resources=resources)
    pictures: dict[str, bytes] = found.get("outputs", {})
    return _read_by_sphinx(text), pictures


def _read_by_sphinx(text: str) -> str:
    """Mark cells as IPython; the text above describes a picture."""
    return text.replace("```python\n", "```ipython3\n").replace(
        "![png](", "![drawn by the cell above]("
    )
