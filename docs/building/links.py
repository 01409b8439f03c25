"""Links between files of the repository, as links between pages of the site."""

from __future__ import annotations

import posixpath
import re
from pathlib import Path

HOMES = {
    "README.md": "index.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
}
_LINK = re.compile(r"(!?)\[([^\]]*)\]\((?!https?:|#|mailto:)([^)#\s]*)(#[^)\s]*)?\)")


def targets(text: str, folder: str = "") -> list[str]:
    """Return the files of the repository to which a file in ``folder`` links."""
    return [posixpath.normpath(posixpath.join(folder, one[2])) for one in _LINK.findall(text)]


def relinked(text: str, folder: str = "") -> str:
    """Return a file's text; what does not stand on the site is named and not linked."""

    def link(match: re.Match[str]) -> str:
        picture, words, target, anchor = match.groups()
        path = posixpath.normpath(posixpath.join(folder, target))
        page = page_of(path)
        if page is not None:
            return f"{picture}[{words}]({page}{anchor or ''})"
        return words if words.strip("`") == path else f"{words} (`{path}`)"

    return _LINK.sub(link, text)


def page_of(target: str) -> str | None:
    """Return the page of the site that shows a file of the repository; None where there is none."""
    if target in HOMES:
        return HOMES[target]
    if target.startswith("docs/"):
        return target.removeprefix("docs/")
    if target.startswith("notebooks/") and target.endswith(".ipynb"):
        return f"tutorials/{Path(target).stem}.md"
    return None
