"""Links of README and its like, which stand in the repository's top folder, as links of pages."""

from __future__ import annotations

import re
from pathlib import Path

HOMES = {
    "README.md": "index.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
}
_LINK = re.compile(r"(!?)\[([^\]]*)\]\((?!https?:|#|mailto:)([^)#\s]*)(#[^)\s]*)?\)")


def relinked(text: str) -> str:
    """A file's text; what does not stand on the site is named and not linked."""
    return _LINK.sub(_link, text)


def _link(match: re.Match[str]) -> str:
    picture, words, target, anchor = match.groups()
    page = page_of(target)
    if page is not None:
        return f"{picture}[{words}]({page}{anchor or ''})"
    return words if words.strip("`") == target else f"{words} (`{target}`)"


def page_of(target: str) -> str | None:
    """Return the page of the site that shows a file of the repository; None where there is none."""
    if target in HOMES:
        return HOMES[target]
    if target.startswith("docs/"):
        return target.removeprefix("docs/")
    if target.startswith("notebooks/") and target.endswith(".ipynb"):
        return f"tutorials/{Path(target).stem}.md"
    return None
