"""Measure what an effect is worth in other programs, and what a contact without memory costs.

Two sections of docs/exports.md, each with its picture.

    python validation/exported.py data/hidden.csv -o docs/exports.md

The record is diagnosed, fitted as it is and with the effects that were named (the commands
themselves: one test is fitted, the others are not), and both fits are exported to C, FMU, MuJoCo
and MATLAB. Each export is run along the motion of every test, and its force is set against the
measured one. The contacts that are exported for simulators are run in MuJoCo and in Drake at every
reading, and their errors are those that the exports state. Fits are kept in build/exported. What a
machine lacks (FMPy, MuJoCo, GNU Octave, Drake) is left out, and said; gcc it must have.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import json
import re
import subprocess
import sys
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from results import ROOT, Origin
from simulators import TARGETS, lacking, of_drake, of_mujoco

import qlvbayes as q
from qlvbayes.io.files import write_whole
from qlvbayes.use.exports.simulators import hunt_crossley, soft_constraint

PICTURE = ROOT / "docs" / "pictures" / "exports_effect.png"
CONTACTS = ROOT / "docs" / "pictures" / "exports_contacts.png"
_FINE = 8  # straight lines in each stretch of the motion between two of its knots
_HEADING = "## What an effect is worth\n"
_SECTION = """{heading}
`{record}` is one pad's six tests ({origin}). `qlvbayes diagnose` names {named}. Exported
without and with it, and run along the motion of each test, this is how far the force of the C
header is from the record's (root mean square over the test's largest force):

| test | rate | noise | without | with {named} |
|---|---:|---:|---:|---:|
{tests}

and by each export, over all tests:

| `--to` | without | with {named} | from the C header at most |
|---|---:|---:|---:|
{targets}

![force of the fastest test, and the error of each]({picture})

*Left: what is left of the fastest test in press and first hold. Right: each test's error.* Only
{fitted} was fitted. {absent}Made by `{command}` on {date} at {commit}.
"""

_COST_HEADING = "## What a contact without memory costs\n"
_COST = """{heading}
Of the same pad, with {named}: root mean square of the force less the measured one, over the test's
largest force. Contacts and joint are those closest to the pad's model along its own tests; the last
column is the model itself, which MuJoCo's plugin steps, as the C header and the FMU do.

| test | role | phase | {columns} |
|---|---|---|{rules}
{rows}
| all | | | {whole} |

![measured force of a test, and that of each contact]({picture})

*A test that was not fitted: its press and the beginning of the hold, and all of it.* A contact
knows the depth and the speed of the moment, and so one force for the whole of a hold. Where the
last column is small and the others are not, no numbers of a plain contact will do, and the plugin
(or the C header behind a force of one's own) will: here it is within {worst:.1%} of the peak in
every phase of every test that was not fitted. {run} Made by `{command}` on {date} at {commit}.
"""
_UNIT = {"height": 10.0, "area": 200.0}  # mm, mm2: of a block, for Drake's hydroelastic contact

_MUJOCO = ("solref of 0.1 kg (1/s2, 1/s)", "solimp (1, 1, m, 1, 1)")


@dataclass(frozen=True, eq=False)
class Trial:
    """A measured test, and the motion that exports are sent along, which holds its times.

    speed: at the readings.
    """

    name: str
    rate: float
    time: np.ndarray
    force: np.ndarray
    grid: np.ndarray
    depth: np.ndarray
    speed: np.ndarray

    def error(self, found: np.ndarray) -> float:
        """Root mean square over the largest force; ``found`` on the grid."""
        off = self.at_readings(found) - self.force
        return float(np.sqrt(np.mean(off**2)) / np.max(self.force))

    def pressed(self) -> tuple[np.ndarray, np.ndarray]:
        """Depth (m) and speed (m/s) at the readings, pressed or not."""
        return 1e-3 * self.at_readings(self.depth), 1e-3 * self.speed

    def at_readings(self, found: np.ndarray) -> np.ndarray:
        """Return the values at the readings, of those on the grid."""
        return found[np.searchsorted(self.grid, self.time)]


def trials(pad: q.Specimen) -> list[Trial]:
    """All tests of the pad, the slowest first."""
    found = []
    for trial in pad.experiment.trials:
        time, path = np.asarray(trial.test.time), trial.trajectory
        knots = np.unique(np.clip([time[0], *path.knots, time[-1]], time[0], time[-1]))
        between = [np.linspace(a, b, _FINE, endpoint=False) for a, b in pairwise(knots)]
        grid = np.unique(np.concatenate([time, *between]))
        depth = np.asarray(path.displacement(grid))
        force = np.asarray(trial.test.force)
        speed = np.asarray(path.velocity(time))
        found.append(Trial(trial.name, trial.rate, time, force, grid, depth, speed))
    return sorted(found, key=lambda x: x.rate)


def command(*words: object) -> None:
    """Run a command of qlvbayes, in a process of its own."""
    subprocess.run([sys.executable, "-m", "qlvbayes", *map(str, words)], check=True)


def named_effects(record: Path, pad: str, kept: Path, seed: int) -> list[str]:
    """Return the effects that the diagnosis names."""
    if not (kept / "diagnosis" / pad / "diagnosis.json").is_file():
        command("diagnose", record, "-o", kept / "diagnosis", "--seed", seed)
    return json.loads((kept / "diagnosis" / pad / "diagnosis.json").read_text())["effects"]


def fitted(record: Path, pad: str, folder: Path, effects: list[str], seed: int) -> None:
    """A fit with these effects."""
    if not (folder / pad / "posterior.nc").is_file():
        added = [word for name in effects for word in ("--add", name)]
        command("fit", record, *added, "-o", folder, "--seed", seed)


def forces(out: Path, pad: str, target: str, every: list[Trial]) -> list[np.ndarray]:
    """Return the force that an export gives for each test's motion."""
    files = q.export(out, pad, target)
    (name,) = {x.name.removesuffix(x.suffix) for x in files if x.suffix in (".h", ".fmu", ".m")} - {
        x.stem for x in files if x.stem.endswith("_draws")
    }
    run = TARGETS[target][0]
    return [run(files[0].parent, name, np.diff(x.grid, prepend=x.grid[0]), x.depth) for x in every]


@dataclass(frozen=True, eq=False)
class Cost:
    """Errors of contacts as the exports state them, and where each is run.

    stated: by target the error file; run: sentences on the simulators; curves: forces of the
    fastest test by name.
    """

    stated: dict[str, dict[str, Any]]
    run: tuple[str, ...]
    curves: dict[str, np.ndarray]

    @property
    def names(self) -> dict[str, tuple[str, str]]:
        """Target and column of the export's file, by the name of the column here."""
        found = {}
        for target, column, name in (
            ("mujoco", "contact", "MuJoCo contact"),
            ("mujoco", "joint", "MuJoCo joint"),
            ("drake", "point contact", "Drake contact"),
            ("mujoco", "with memory", "with memory"),
        ):
            found[name] = (target, column)
        return found

    def rows(self) -> list[str]:
        """Return the rows of the table, one for each cell."""
        rows = []
        for i, cell in enumerate(self.stated["mujoco"]["cells"]):
            errors = [
                self.stated[target]["cells"][i]["rms_over_peak"][column]
                for target, column in self.names.values()
            ]
            phase = {"unload": "unloading"}.get(cell["phase"], cell["phase"])
            cells = " | ".join(f"{x:.1%}" for x in errors)
            rows.append(f"| {cell['test']} | {cell['role']} | {phase} | {cells} |")
        return rows

    def whole(self) -> str:
        """Return the error over all cells."""
        found = [self.stated[t]["whole"][column]["rms"] for t, column in self.names.values()]
        return " | ".join(f"{x:.1%}" for x in found)

    def worst(self) -> float:
        """Return the largest error of the model with memory in a phase of a test not fitted."""
        return max(
            cell["rms_over_peak"]["with memory"]
            for cell in self.stated["mujoco"]["cells"]
            if cell["role"] == "validate"
        )


def cost(out: Path, pad: str, every: list[Trial]) -> Cost:
    """Export the contacts of a pad and run them at every reading of every test."""
    stated, texts = {}, {}
    for target in ("mujoco", "drake"):
        files = q.export(out, pad, target, **_UNIT)
        for file in files:
            texts[file.name.removeprefix(f"pad_{pad}")] = file.read_text()
        stated[target] = json.loads(texts["_error.json"])
    solref, solimp = (stated["mujoco"]["numbers"][key] for key in _MUJOCO)
    point = list(stated["drake"]["numbers"].values())
    sides = {
        "MuJoCo": (
            "mujoco",
            lambda x, v: of_mujoco(texts["_contact.xml"], x, v),
            lambda x, v: soft_constraint(x, v, -solref[0], -solref[1], tuple(solimp), mass=0.1),
        ),
        "Drake (point)": (
            "pydrake",
            lambda x, v: of_drake(texts[".sdf"], x, v),
            lambda x, v: hunt_crossley(x, v, *point[:2]),
        ),
        "Drake (hydroelastic)": (
            "pydrake",
            lambda x, v: of_drake(texts[".sdf"], x, v, hydroelastic=True),
            lambda x, v: hunt_crossley(x, v, *point[:2]),
        ),
    }
    run = []
    for name, (needed, theirs, ours) in sides.items():
        if lacking(needed):
            run.append(f"{name} is not on this machine.")
            continue
        off = 0.0
        for trial in every:
            x, v = trial.pressed()
            mine = ours(x, v)
            off = max(off, float(np.max(np.abs(theirs(x, v) - mine)) / np.max(mine)))
        version = importlib.metadata.version(needed.removeprefix("py"))
        run.append(f"{name} {version} is off the exported law by {off:.0e} of the peak at most.")
    x, v = every[-1].pressed()
    curves = {
        "MuJoCo contact": sides["MuJoCo"][2](x, v),
        "Drake contact": sides["Drake (point)"][2](x, v),
    }
    return Cost(stated, tuple(run), curves)


def contacts_picture(last: Trial, costs: Cost, header: np.ndarray) -> Figure:
    """The measured force of the fastest test and that of each contact."""
    figure = Figure(figsize=(6.7, 3.0), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    loaded = last.grid[np.argmax(last.depth > 0.99 * np.max(last.depth))]
    shown = {**costs.curves, "with memory": last.at_readings(header)}
    colours = ("#e69f00", "#009e73", "#0072b2")
    for ax in (left, right):
        ax.plot(last.time, last.force, ".", color="0.6", ms=3, label="measured")
        for (name, force), colour in zip(shown.items(), colours, strict=True):
            ax.plot(last.time, force, color=colour, lw=1.0, label=name)
        ax.spines[["top", "right"]].set_visible(False)
        ax.set(xlabel="time (s)")
    left.set(xlim=(0.0, 6.0 * loaded), ylabel="force (N)", title=f"test {last.name}: press")
    right.set(title="all of it")
    right.legend(frameon=False)
    return figure


def picture(
    every: list[Trial], without: list[np.ndarray], with_: list[np.ndarray], noise: float
) -> Figure:
    """Draw what is left of the fastest test's force, and the error of each test."""
    figure = Figure(figsize=(6.7, 3.0), layout="constrained")
    left, right = figure.subplots(1, 2)
    last = every[-1]
    end = 4.0 * last.grid[np.argmax(last.depth > 0.99 * np.max(last.depth))]
    seen = last.time <= end
    rates = [x.rate for x in every]
    sides = ((without, "o--", "#d55e00", "without"), (with_, "o-", "#0072b2", "with the effect"))
    for found, sign, colour, label in sides:
        off = (last.force - last.at_readings(found[-1]))[seen]
        left.plot(last.time[seen], off, sign, color=colour, ms=2, lw=0.8, label=label)
        errors = [100.0 * x.error(f) for x, f in zip(every, found, strict=True)]
        right.semilogx(rates, errors, sign, color=colour, ms=4)
    left.axhspan(-noise, noise, color="0.9", lw=0.0, label="noise")
    right.semilogx(
        rates, [100.0 * noise / np.max(x.force) for x in every], ":", color="0.4", label="noise"
    )
    left.set(xlabel="time (s)", ylabel="measured less export (N)", title=f"test {last.name}")
    left.legend(frameon=False)
    right.set(xlabel="rate (mm/s)", ylabel="error (% of the largest force)", ylim=(0.0, None))
    right.legend(frameon=False)
    for ax in (left, right):
        ax.spines[["top", "right"]].set_visible(False)
    return figure


def _rms(errors: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(errors))))


def main() -> None:
    """Run all, write the section and the picture."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("record", type=Path)
    parser.add_argument("-o", "--page", type=Path, default=ROOT / "docs" / "exports.md")
    parser.add_argument("--kept", type=Path, default=ROOT / "build" / "exported")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    study = q.read_study(given.record)
    (pad,) = list(study)
    specimen = study[pad]
    every = trials(specimen)
    named = named_effects(given.record, pad, given.kept, given.seed)
    outs = given.kept / "without", given.kept / "with"
    for out, effects in zip(outs, ([], named), strict=True):
        fitted(given.record, pad, out, effects, given.seed)
    present = [name for name, (_, needed) in TARGETS.items() if not lacking(needed)]
    found = {(out, name): forces(out, pad, name, every) for out in outs for name in present}
    headers = [found[out, "c"] for out in outs]
    rows, targets = [], []
    for i, trial in enumerate(every):
        errors = " | ".join(f"{trial.error(x[i]):.2%}" for x in headers)
        noise = specimen.experiment.floor.total / np.max(trial.force)
        rows.append(f"| {trial.name} | {trial.rate:.3g} mm/s | {noise:.2%} | {errors} |")
    for name in present:
        sides = [found[out, name] for out in outs]
        errors = [_rms([t.error(f) for t, f in zip(every, x, strict=True)]) for x in sides]
        off = max(
            float(np.max(np.abs(f - h)) / np.max(h))
            for side, header in zip(sides, headers, strict=True)
            for f, h in zip(side, header, strict=True)
        )
        targets.append(f"| `{name}` | {errors[0]:.2%} | {errors[1]:.2%} | {off:.0e} |")
    absent = [needed for name, (_, needed) in TARGETS.items() if name not in present]
    origin = Origin.now()
    section = _SECTION.format(
        heading=_HEADING,
        record=given.record,
        origin="simulated" if "simulated" in given.record.open().readline() else "measured",
        named=" and ".join(f"`{name}`" for name in named),
        tests="\n".join(rows),
        targets="\n".join(targets),
        picture="pictures/" + PICTURE.name,
        fitted=" and ".join(x.name for x in specimen.experiment.with_role("fit")),
        absent=f"Not on this machine: {', '.join(absent)}. " if absent else "",
        command=origin.command,
        date=origin.date,
        commit=origin.commit,
    )
    picture(every, *headers, specimen.experiment.floor.total).savefig(PICTURE, dpi=200)
    costs = cost(outs[1], pad, every)
    contacts_picture(every[-1], costs, headers[1][-1]).savefig(CONTACTS, dpi=200)
    contacts = _COST.format(
        heading=_COST_HEADING,
        named=" and ".join(f"`{name}`" for name in named),
        columns=" | ".join(costs.names),
        rules="---:|" * len(costs.names),
        rows="\n".join(costs.rows()),
        whole=costs.whole(),
        picture="pictures/" + CONTACTS.name,
        worst=costs.worst(),
        run=" ".join(costs.run),
        command=origin.command,
        date=origin.date,
        commit=origin.commit,
    )
    page = given.page.read_text(encoding="utf-8")
    for heading, text in ((_HEADING, section), (_COST_HEADING, contacts)):
        older = re.compile(re.escape(heading) + r".*?(?=^## |\Z)", re.DOTALL | re.MULTILINE)
        if not older.search(page):
            sys.exit(f"{given.page} has no section {heading!r}")
        page = older.sub(lambda _, new=text: new + "\n", page)
    write_whole(given.page, page.encode())
    print(section, contacts, sep="\n")


if __name__ == "__main__":
    main()
