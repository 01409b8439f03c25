"""Write command lines that repeat a session's last model."""

from __future__ import annotations

from pathlib import Path

from qlvbayes.app.sessions import Session
from qlvbayes.io.wording import as_typed


def commands(session: Session, pad: str) -> str:
    """Return command lines that sample the current state's model, check it, and diagnose.

    They begin with the one that makes the measurements, where they were files of other layouts.
    """
    own = session.pad(pad)
    state = own.state(own.current)
    data = Path(session.data).name
    lines = []
    if session.made is not None:
        files = [f"./{name}" if name.startswith("-") else name for name in session.made.files]
        options = [w for name, value in session.made.options.items() for w in (f"--{name}", value)]
        lines.append(["qlvbayes", "look", *files, *options, "-o", data])
    fit = ["qlvbayes", "fit", data, "--pads", pad, "--all-tests"]
    fit += ["--elastic", state.elastic, "--relaxation", state.relaxation]
    fit += [word for name in state.effects for word in ("--add", name)]
    lines += [
        [*fit, "-o", "out"],
        ["qlvbayes", "check", "out"],
        ["qlvbayes", "diagnose", data, "--pads", pad, "-o", "out"],
        ["qlvbayes", "report", "out"],
    ]
    return "\n".join(as_typed(*words) for words in lines) + "\n"
