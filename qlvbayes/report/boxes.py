"""The verdict on each pad in a box: one line, what was named, and the error on tests left out."""

from __future__ import annotations

from dataclasses import dataclass

from qlvbayes.checks import InputError
from qlvbayes.effects.catalogue import find
from qlvbayes.report.collect import PadResults
from qlvbayes.report.numbers import number, percent, with_unit
from qlvbayes.wording import joined


@dataclass(frozen=True)
class Named:
    """An effect of the verdict and what one sees of it."""

    name: str
    seen: str


@dataclass(frozen=True)
class Bar:
    """An error as a bar: its share of the longest, and its number."""

    label: str
    share: float
    text: str
    kind: str


@dataclass(frozen=True)
class Box:
    """What the reader is told first about one pad."""

    pad: str
    fluid: str | None
    kind: str
    badge: str
    line: str
    effects: tuple[Named, ...]
    bars: tuple[Bar, ...]
    bars_title: str
    warnings: tuple[str, ...]
    remedy: str | None


_BADGES = {
    "adequate": "adequate",
    "missing_effect": "effect found",
    "ambiguous": "ambiguous",
    "unexplained": "unexplained",
}


def verdict_box(pad: PadResults, remedy: str) -> Box:
    """The box of one pad; ``remedy`` is the command that would diagnose it."""
    found = pad.diagnosis
    verdict = found["verdict"] if found else ""
    shown = list(found["group"] or found["effects"]) if found else []
    return Box(
        pad.name,
        pad.fluid,
        verdict or "open",
        _BADGES.get(verdict, verdict or "not diagnosed"),
        verdict_line(found) if found else _undiagnosed(pad),
        tuple(Named(name, seen(name)) for name in shown),
        _bars(found, pad.force_unit) if found else (),
        "Error on tests left out (root mean square)" if found else "",
        tuple(_warnings(pad)),
        None if found else remedy,
    )


def seen(name: str) -> str:
    """What one would see of an effect; nothing for a user's own."""
    try:
        return find(name).seen
    except InputError:
        return ""


def verdict_line(found: dict) -> str:
    """The verdict in one line; named effects follow it."""
    many = len(found["effects"]) > 1
    return {
        "adequate": "Nothing is missing that these tests can show.",
        "missing_effect": f"The plain model lacks {'these effects' if many else 'one effect'}"
        f"{_sure(found)}:",
        "ambiguous": f"Something is missing{besides(found)}, and these tests cannot tell which of "
        "these it is:",
        "unexplained": "Something is missing that none of the known effects explains.",
    }.get(found["verdict"], found["verdict"])


def besides(found: dict) -> str:
    """What an ambiguous verdict is sure of; the last effect stands for the group."""
    sure = list(found["effects"][:-1])
    return f" besides {joined(sure)}" if sure else ""


def _sure(found: dict) -> str:
    named = {entry["effect"]: entry["probability"] for entry in found["ranking"]}
    if len(found["effects"]) != 1 or found["effects"][0] not in named:
        return ""
    if other_form(found["steps"][-1]):
        return ", not by its usual law"
    return f" (probability {percent(named[found['effects'][0]])})"


def _undiagnosed(pad: PadResults) -> str:
    check = pad.final.check
    if check is None:
        return "Fitted, but neither checked nor diagnosed."
    fails = sum(bool(cell.get("fails")) for cell in check["cells"])
    if not fails:
        return "Not diagnosed. The fit leaves no structure in any phase of any test."
    return f"Not diagnosed. The fit fails in {fails} of {len(check['cells'])} phases of its tests."


def _bars(found: dict, unit: str) -> tuple[Bar, ...]:
    first, last = found["steps"][0], found["steps"][-1]
    kind = "after" if found["verdict"] == "adequate" else "before"
    rows = [("plain model", first["heldout_rmse_N"], kind)]
    if last["effects"] != first["effects"]:
        added = " + ".join(e for e in last["effects"] if e not in first["effects"])
        rows.append((f"with {added}", last["heldout_rmse_N"], "after"))
    if first["effects"]:
        rows[0] = (f"with {' + '.join(first['effects'])}", *rows[0][1:])
    rows.append(("noise alone", found["noise_N"], "noise"))
    longest = max((value for _, value, _ in rows if value), default=1.0)
    return tuple(
        Bar(label, (value or 0.0) / longest, with_unit(number(value, zeros=True), unit), kind)
        for label, value, kind in rows
    )


def _warnings(pad: PadResults) -> list[str]:
    summary = pad.final.summary
    troubles = summary.get("troubles", []) if summary and not summary["converged"] else []
    found = [f"The sampling has not converged: {text}." for text in troubles]
    found += [f"{text}." for text in (summary or {}).get("notices", [])]
    other = other_form(pad.diagnosis["steps"][-1]) if pad.diagnosis else None
    if other in ((pad.final.summary or {}).get("effects") or []):
        found.append(
            f"{other} acts by another law than the usual one, with which the constants below were "
            "fitted; the diagnosis gives them by its own."
        )
    return found


def other_form(step: dict) -> str | None:
    """The effect of a step that has another form than the list's."""
    return (step.get("other_form") or {}).get("effect")
