"""Lay out the pages of the site in one folder and build it: ``make docs``.

Pages come from docs/ (those that hold templates filled in from the code), from README,
CONTRIBUTING and CHANGELOG, and from the notebooks as they are.
"""

from __future__ import annotations

import re
import shutil
import sys
from pathlib import Path

from links import HOMES, relinked
from sphinx.cmd.build import main as sphinx_build
from tutorials import converted
from values import filled

DOCS = Path(__file__).parents[1]
ROOT = DOCS.parent
TEMPLATE = "%% template"  # first line of a page that quotes the code
_PAGE = re.compile(r"[a-z_/]+")


def stage(folder: Path) -> None:
    """Write every page and picture into a fresh folder."""
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(
        DOCS, folder, ignore=shutil.ignore_patterns("building", "*.py", "__pycache__", "*.json")
    )
    for page in sorted((*folder.rglob("*.md"), *folder.rglob("*.rst"))):
        text = page.read_text(encoding="utf-8")
        if text.startswith(TEMPLATE):
            page.write_text(filled(text.removeprefix(TEMPLATE).lstrip()), encoding="utf-8")
    for source, page in HOMES.items():
        text = relinked((ROOT / source).read_text(encoding="utf-8"))
        (folder / page).write_text(text, encoding="utf-8")
    tutorials = folder / "tutorials"
    tutorials.mkdir(exist_ok=True)
    for path in sorted((ROOT / "notebooks").glob("*.ipynb")):
        text, pictures = converted(path)
        (tutorials / f"{path.stem}.md").write_text(text, encoding="utf-8")
        for name, content in pictures.items():
            target = tutorials / name
            target.parent.mkdir(exist_ok=True)
            target.write_bytes(content)
    with (folder / "index.md").open("a", encoding="utf-8") as home:
        home.write(_contents(folder))


def _contents(folder: Path) -> str:
    """The site's contents; a page that is made elsewhere may not be there yet."""
    lines = (folder / "contents.txt").read_text(encoding="utf-8").splitlines()
    return "\n".join(line for line in lines if not _missing(folder, line)) + "\n"


def _missing(folder: Path, line: str) -> bool:
    names = [folder / f"{line}.md", folder / f"{line}.rst"]
    return bool(_PAGE.fullmatch(line)) and not any(name.exists() for name in names)


def build(folder: Path, site: Path) -> int:
    """Stage and build; 0 if nothing was to be warned of."""
    stage(folder)
    words = ["-b", "html", "-c", str(DOCS), "-W", "--keep-going", "-q", str(folder), str(site)]
    return int(sphinx_build(words))


if __name__ == "__main__":
    status = build(ROOT / "build" / "pages", ROOT / "build" / "site")
    if status == 0:
        print(f"site: {ROOT / 'build' / 'site' / 'index.html'}")
    sys.exit(status)
