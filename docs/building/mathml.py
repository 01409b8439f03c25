"""Formulas as MathML, written while the site is built: no script and no font is fetched."""

from __future__ import annotations

from typing import Any

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx


def setup(app: Sphinx) -> dict[str, bool]:
    """Offer the renderer to ``html_math_renderer``."""
    app.add_html_math_renderer("mathml", (inline, None), (displayed, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _formula(latex: str, display: str) -> str:
    """The converter sets no space around the logarithm."""
    return str(convert(latex.strip().replace("\\ln ", "\\,\\ln\\,"), display=display))


def inline(writer: Any, node: nodes.math) -> None:
    """A formula within a line."""
    writer.body.append(_formula(node.astext(), "inline"))
    raise nodes.SkipNode


def displayed(writer: Any, node: nodes.math_block) -> None:
    """A formula of its own."""
    formula = _formula(node.astext(), "block")
    writer.body.append(f'<div class="formula">{formula}</div>\n')
    raise nodes.SkipNode
