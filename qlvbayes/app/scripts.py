"""Write the steps of a session as a Python script and as command lines."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from qlvbayes.app.sessions import HistoryState, Session
from qlvbayes.io.escaping import as_typed


def script(session: Session, pad: str) -> str:
    """Return a script that arrives at the current state's constants by the same steps."""
    own = session.pad(pad)
    data = Path(session.data).name
    made = [f" {data} is made by: {as_typed(*words)}" for words in _convert(session)]
    lines = [
        repr(f"Repeats what was done by hand to pad {pad} of {session.name}.{''.join(made)}"),
        "",
        "import qlvbayes as q",
        "",
        f"study = q.read_study({data!r})",
        "choices = q.Choices(bonded=study.units.bonded_default)",
        f"bench = q.Bench.from_experiment(study[{pad!r}].experiment, choices)",
        "",
    ]
    path = _path(own.history, own.current)
    for state, before in zip(path, [None, *path[:-1]], strict=True):
        lines += _step(state, before)
    lines += [
        "",
        "look = bench.look(model)",
        "for name, value in look.values.items():",
        '    print(f"{name:24s} {value:.6g}")',
        "*_, left_out = bench.held_out(model)",
        'print(f"error {look.error:.4g}, on tests left out {left_out:.4g}")',
        'print(f"noise {bench.noise:.4g}")',
    ]
    return "\n".join(lines) + "\n"


def _path(history: list[HistoryState], current: int) -> list[HistoryState]:
    """Return the states that led to one, in order."""
    by_number = {state.id: state for state in history}
    path = [by_number[current]]
    while path[-1].parent is not None and path[-1].parent in by_number:
        path.append(by_number[path[-1].parent])
    return path[::-1]


def _step(state: HistoryState, before: HistoryState | None) -> list[str]:
    """Return the lines that make a state from the one before."""
    if before is None:
        if state.how == "start":
            return ["model = bench.first()"]
        return [f"model = {_by_hand(state.model)}"]
    if state.how == "kept":
        return [f"model = {_by_hand(state.model)}"]
    # the sliders may have been moved since
    moved = state.begun != before.values
    lines = [f"model = {_by_hand(before.model | {'values': state.begun})}"] if moved else []
    word, _, name = state.how.partition(" ")
    if word in ("add", "remove"):
        return [*lines, f"model = bench.{word}(model, {name!r})"]
    if word == "fit":
        return [*lines, "model = bench.fit(model)"]
    laws = {
        key: getattr(state, key)
        for key in ("elastic", "relaxation")
        if getattr(state, key) != getattr(before, key)
    }
    given = ", ".join(f"{key}={value!r}" for key, value in laws.items())
    return [*lines, f"model = bench.rebase(model, {given})"]


def _by_hand(model: dict[str, Any]) -> str:
    effects, values = tuple(model["effects"]), dict(model["values"])
    return f"q.ByHand({model['elastic']!r}, {model['relaxation']!r}, {effects!r}, {values!r})"


def commands(session: Session, pad: str) -> str:
    """Return command lines that sample the current state's model, check it, and diagnose."""
    own = session.pad(pad)
    state = own.state(own.current)
    data = Path(session.data).name
    fit = ["qlvbayes", "fit", data, "--pads", pad, "--all-tests"]
    fit += ["--elastic", state.elastic, "--relaxation", state.relaxation]
    fit += [word for name in state.effects for word in ("--add", name)]
    lines = [
        *_convert(session),
        [*fit, "-o", "out"],
        ["qlvbayes", "check", "out"],
        ["qlvbayes", "diagnose", data, "--pads", pad, "-o", "out"],
        ["qlvbayes", "report", "out"],
    ]
    return "\n".join(as_typed(*words) for words in lines) + "\n"


def _convert(session: Session) -> list[list[str]]:
    """Return the command that makes the measurements, where they were files of other layouts."""
    if session.made is None:
        return []
    options = [
        word for name, value in session.made["options"].items() for word in (f"--{name}", value)
    ]
    files = [f"./{name}" if name.startswith("-") else name for name in session.made["files"]]
    data = Path(session.data).name
    return [["qlvbayes", "convert", *files, *options, "-o", data]]
