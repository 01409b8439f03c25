"""Finished fits as JSON lines, so that an interrupted run goes on."""

from __future__ import annotations

import ast
import hashlib
import json
import sys
from pathlib import Path


class Kept:
    """One file of finished fits, a line each; a line cut short by a kill counts as absent."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.fits: dict[int, dict] = {}
        if path.exists():
            text = path.read_text(encoding="utf-8")
            lines = text.split("\n")[:-1]
            if not text.endswith("\n"):
                path.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
            self.fits = {fit["index"]: fit for fit in map(json.loads, lines)}

    def add(self, fit: dict) -> None:
        """Write one fit."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(fit) + "\n")
        self.fits[fit["index"]] = fit

    def first(self, count: int) -> list[dict]:
        """Return the fits of the first ``count`` pads, in order."""
        return [self.fits[k] for k in sorted(self.fits) if k < count]


def code_digest() -> str:
    """Digest of the package's loaded modules, comments and layout aside.

    Fits made by other code must not be mixed with new ones.
    """
    digest = hashlib.sha256()
    modules = [name for name in sys.modules if name.split(".")[0] == "qlvbayes"]
    for name in sorted(modules):
        file = getattr(sys.modules[name], "__file__", None)
        if file:
            tree = ast.parse(Path(file).read_text(encoding="utf-8"))
            digest.update(f"{name}\n{ast.dump(tree)}\n".encode())
    return digest.hexdigest()[:12]
