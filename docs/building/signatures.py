"""Signatures that Sphinx cannot read as Python: defaults that are made anew each time."""

from __future__ import annotations

from sphinx.application import Sphinx


def setup(app: Sphinx) -> dict[str, bool]:
    """Look at every signature before it is read."""
    app.connect("autodoc-process-signature", readable)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def readable(
    app: Sphinx, what: str, name: str, obj: object, options: object, signature: str, answer: str
) -> tuple[str, str] | None:
    """The same with an ellipsis for such a default; None leaves it as it is."""
    if signature and "<factory>" in signature:
        return signature.replace("<factory>", "..."), answer
    return None
