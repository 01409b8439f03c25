"""Run the server's process, as a file, in an interpreter that never loads JAX.

``import qlvbayes`` may load JAX. An empty package in its place lets the server's modules be
imported without it.
"""

import json
import sys
import types
from pathlib import Path


def main() -> None:
    """Serve with the options of the first argument, in JSON (`server.Options`)."""
    bare = types.ModuleType("qlvbayes")
    bare.__path__ = [str(Path(__file__).resolve().parents[1])]
    sys.modules["qlvbayes"] = bare
    from qlvbayes.app.server import Options, serve

    serve(Options(**json.loads(sys.argv[1])))


if __name__ == "__main__":
    main()
