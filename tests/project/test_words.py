"""Check the rules of "Words" in CONTRIBUTING.md on docstrings and names outside the tests."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FRAGMENT = re.compile(r"(Of|What|Whether|How|When|That|Those)\b")
PRIVATE = re.compile(r"told|tell|beside|promis\w*|usual|weighed|lanes|bow")
STORED = {"promised"}  # keys of stored JSON, which fields of a record may have
DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


def offences(node):
    """Yield the docstring and the names of a node of the syntax tree that break a rule."""
    text = (ast.get_docstring(node) or "") if isinstance(node, DOCUMENTED) else ""
    if FRAGMENT.match(text):
        yield text.splitlines()[0]
    stored = isinstance(getattr(node, "ctx", None), ast.Store)
    named = isinstance(node, (*DOCUMENTED[1:], ast.arg))
    for key in ("name", "arg") if named else ("id", "attr") if stored else ():
        name = getattr(node, key, "")
        if name not in STORED and PRIVATE.fullmatch(name.strip("_").lower()):
            yield name


@pytest.mark.parametrize("folder", ["qlvbayes", "validation", "benchmarks", "docs/building"])
def test_docstrings_are_sentences_and_names_are_the_fields(folder):
    files = sorted((ROOT / folder).rglob("*.py"))
    assert files
    assert not [
        f"{path.relative_to(ROOT)}:{getattr(node, 'lineno', 1)} {offence}"
        for path in files
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        for offence in offences(node)
    ]
