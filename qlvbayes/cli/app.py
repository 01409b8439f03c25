"""``qlvbayes app``: the bench in the browser."""

from __future__ import annotations

import os
import secrets
import sys
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path

from qlvbayes.app.sessions import holds_results
from qlvbayes.io.checks import InputError
from qlvbayes.io.wording import as_typed

_NEEDED = ("starlette", "uvicorn", "python_multipart")


def app(
    file: Path | None = None,
    port: int = 0,
    host: str = "127.0.0.1",
    behind: str | None = None,
    sessions: Path | None = None,
    browser: bool = True,
    effects_file: Path | None = None,
) -> None:
    """Open the bench in the browser: curves, sliders, effects to add and to take out, jobs.

    Serves one page at an address of this machine, with a token that only this terminal shows.

    Options:
    file FILE: Measurements, or a folder of results.
    port 0..65535: Port; 0 takes a free one.
    host: Address to listen at. Any but 127.0.0.1 lets other machines in: whoever has the token sees
        all sessions and uses this machine, and nothing is encrypted.
    behind: Address of a proxy that encrypts, as https://bench.lab.example: the one under which the
        page is then reached.
    sessions: Folder of the sessions. Default: qlvbayes/sessions in the user's data folder.
    browser --browser/--no-browser: Open the browser.
    effects_file: A Python file with effects of your own.
    """
    if missing := [name for name in _NEEDED if find_spec(name) is None]:
        what = f"the bench needs {', '.join(missing)}"
        raise InputError(what, remedy="pip install 'qlvbayes[app]'")
    if file is not None and not file.exists():
        raise InputError("no such file", file=file, remedy="check the path")
    if file is not None and file.is_dir() and not holds_results(file):
        remedy = f"run {as_typed('qlvbayes', 'study', str(file), '-o', 'OUT')} and open OUT"
        raise InputError("no results in this folder", file=file, remedy=remedy)
    if behind is not None and not behind.startswith(("http://", "https://")):
        raise InputError(f"no address {behind!r}", remedy="write https://NAME")
    # imported here: the help does not wait for them, and a server that needs no JAX never loads it
    from qlvbayes.app.server import Options, serve

    if effects_file is not None:
        from qlvbayes.effects.catalogue import own_effects

        own_effects(effects_file)
    base = os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share"
    folder = sessions or Path(base) / "qlvbayes" / "sessions"
    options = Options(
        secrets.token_urlsafe(32), str(folder.resolve()), host=host, port=port, behind=behind,
        open=None if file is None else str(file.resolve()), browser=browser,
        effects_file=None if effects_file is None else str(effects_file.resolve()),
    )  # fmt: skip
    if sys.stderr.isatty():
        print("starting the bench …", file=sys.stderr, flush=True)
    with suppress(KeyboardInterrupt):  # which ends it
        serve(options)
