"""Lay out the pages of the site in one folder and build it: ``make docs``.

Pages come from docs/, whose generated blocks are written anew first, from README, CONTRIBUTING and
CHANGELOG, from the notebooks as they are, and from the docstrings of all public names.
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

from blocks import main as write_blocks
from links import HOMES, relinked
from public import api_pages
from sphinx.cmd.build import main as sphinx_build
from tutorials import converted

DOCS = Path(__file__).parents[1]
ROOT = DOCS.parent


def stage(folder: Path) -> None:
    """Write every page and picture into a fresh folder."""
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(DOCS, folder, ignore=shutil.ignore_patterns("building", "*.py", "__pycache__"))
    for page in sorted(folder.glob("*.md")):
        text = relinked(page.read_text(encoding="utf-8"), "docs")
        page.write_text(text, encoding="utf-8")
    for source, page in HOMES.items():
        text = relinked((ROOT / source).read_text(encoding="utf-8"))
        (folder / page).write_text(text, encoding="utf-8")
    (folder / "api").mkdir()
    for name, text in api_pages().items():
        (folder / "api" / f"{name}.rst").write_text(text, encoding="utf-8")
    tutorials = folder / "tutorials"
    tutorials.mkdir()
    for path in sorted((ROOT / "notebooks").glob("*.ipynb")):
        text, pictures = converted(path)
        (tutorials / f"{path.stem}.md").write_text(text, encoding="utf-8")
        for name, content in pictures.items():
            target = tutorials / name
            target.parent.mkdir(exist_ok=True)
            target.write_bytes(content)
    with (folder / "index.md").open("a", encoding="utf-8") as home:
        home.write((folder / "contents.txt").read_text(encoding="utf-8"))


def build(folder: Path, site: Path) -> int:
    """Stage and build; 0 if nothing was to be warned of."""
    stage(folder)
    words = ["-b", "html", "-c", str(DOCS), "-W", "--keep-going", "-q", str(folder), str(site)]
    return int(sphinx_build(words))


if __name__ == "__main__":
    status = write_blocks() or build(ROOT / "build" / "pages", ROOT / "build" / "site")
    if status == 0:
        print(f"site: {ROOT / 'build' / 'site' / 'index.html'}")
    sys.exit(status)
