"""Is the same best mode found whatever the starts? Writes a page.

Interrupted, it goes on where it was: finished pads lie in build/validation. `--part 0/8` to
`--part 7/8` run them in eight processes, also on several machines, and write no page.
"""

from __future__ import annotations

import argparse
import shlex
import sys
from pathlib import Path

import numpy as np
from coverage import progress
from keeping import Kept, code_digest
from page import Origin

from qlvbayes.diagnosis.workbench import search_of
from qlvbayes.evaluation.population import Population
from qlvbayes.evaluation.wide import make_wide
from qlvbayes.inference.modes import REDRAWN, STARTS, base_modes
from qlvbayes.io.data import Pad, read_measurements
from qlvbayes.io.files import write_whole
from qlvbayes.io.runtime import forget_compiled
from qlvbayes.preprocess.experiment import prepare

ROOT = Path(__file__).resolve().parents[1]
_SAME = 0.5  # of the log density, within which two sets of starts came to one mode

_PAGE = """# Is the same mode found whatever the starts?

The model without effects (exponential law, two Prony modes) of the bundled pads and of pads of the
wide population (`seed {seed}`: other laws, protocols and noises, effects hidden in most; the model
is wrong there, so that its density has more modes) was optimised from {sets} independent sets of
{starts} draws of its priors each; then its relaxation was drawn anew at the elastic constants
found, until {redrawn} in a row led no higher. A set counts as agreeing if its best mode is within
{same} of the best of all sets in log density. Asked for is 99 %.

| | |
|---|---|
| command | `{command}` |
| date | {date} |
| commit | {commit} |
| machine | {machine} |

| pads | sets that agree | pads in which all agree |
|---|---|---|
{rows}

{others}"""


def main() -> None:
    options = _options()
    command = shlex.join([".venv/bin/python", "validation/modes.py", *sys.argv[1:]])
    origin = Origin.now(command, ROOT)
    file = ROOT / "build" / "validation" / code_digest() / f"modes-seed{options.seed}.jsonl"
    part, parts = options.part or (0, 1)
    kept = Kept(file if options.part is None else file.with_name(f"{file.name}.{part}"))
    finished = [Kept(one).fits for one in sorted(file.parent.glob(f"{file.name}*"))]
    fits = {index: fit for some in finished for index, fit in some.items()}
    bundled = _bundled()
    count = len(bundled) + options.pads
    missing = [index for index in range(part, count, parts) if index not in fits]
    with progress() as bar:
        for index in bar.track(missing, description="pads"):
            inside = index < len(bundled)
            pad = bundled[index] if inside else _simulated(options.seed, index - len(bundled))
            if pad is not None:
                losses = _losses(pad, options.sets)
                fits[index] = {"index": index, "pad": pad.name, "machine": origin.machine, **losses}
                kept.add(fits[index])
                forget_compiled()
    if options.part is None:
        found = [fits[index] for index in sorted(fits) if index < count]
        write_whole(options.output, _page(found, len(bundled), options, origin).encode())
        print(options.output)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pads", type=int, default=100, help="simulated ones")
    parser.add_argument("--sets", type=int, default=20, help="sets of starts")
    parser.add_argument("--seed", type=int, default=303, help="of the wide population")
    parser.add_argument("--part", type=_part, metavar="K/N", help="every Nth pad from the Kth on")
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "docs" / "modes.md")
    return parser.parse_args()


def _part(text: str) -> tuple[int, int]:
    part, parts = text.split("/")
    return int(part), int(parts)


def _bundled() -> list[Pad]:
    files = [ROOT / "data" / name for name in ("pads.csv", "hidden.csv")]
    return [pad for file in files for pad in read_measurements(file).pads]


def _simulated(seed: int, index: int) -> Pad | None:
    """None where the simulator finds no balance."""
    try:
        return make_wide(Population(seed), index).pad
    except RuntimeError as error:
        print(f"pad {index} is not made: {error}", file=sys.stderr)
        return None


def _losses(pad: Pad, sets: int) -> dict[str, list[float]]:
    """Lowest loss from every set, inf where none was found."""
    search = search_of(prepare(pad))
    density, usual = search.density, search.usual
    losses = []
    for seed in range(1, sets + 1):
        found = base_modes(density, usual, seed)
        losses.append(found[0].loss if found else float("inf"))
    return {"losses": losses}


def _page(found: list[dict], bundled: int, options: argparse.Namespace, origin: Origin) -> str:
    losses = [np.array(one["losses"]) for one in found]
    agreeing = [own <= own.min() + _SAME for own in losses]
    rows = []
    for words, some in (("bundled", agreeing[:bundled]), ("simulated", agreeing[bundled:])):
        sets, agree = sum(a.size for a in some), sum(int(a.sum()) for a in some)
        if sets:
            whole = sum(bool(a.all()) for a in some)
            rows.append(
                f"| {len(some)} {words} | {agree} of {sets} ({agree / sets:.1%}) | {whole} |"
            )
    others = [
        f"- {one['pad']}: {int((~a).sum())} of {a.size} sets ended lower, by up to "
        f"{own.max() - own.min():.1f}"
        for one, own, a in zip(found, losses, agreeing, strict=True)
        if not a.all()
    ]
    listed = "Pads in which some set ended elsewhere:\n\n" + "\n".join(others) + "\n"
    return _PAGE.format(
        seed=options.seed,
        sets=options.sets,
        starts=STARTS,
        redrawn=REDRAWN,
        same=_SAME,
        rows="\n".join(rows),
        others=listed if others else "No set ended elsewhere.\n",
        command=origin.command,
        date=origin.date,
        commit=origin.commit,
        machine="; ".join(sorted({one["machine"] for one in found})),
    )


if __name__ == "__main__":
    main()
