"""Count how often direct evidence that is beyond doubt is wrong, and how often it is there.

Pads of the lifelike and of the wide population are read and prepared; nothing is fitted. An effect
that the readings show beyond doubt is right if it is hidden, or kin to what is, by the rules of the
counts of names; it is in every hypothesis of a diagnosis, so that a wrong one is a wrong name.
*Shown* are the hidden effects that could be seen and that are shown beyond doubt. Interrupted, the
same command goes on where it was.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from functools import partial

import lifelike_pads
from blind import study as wide
from blind.counting import Case, Rate, bound, true_names
from blind.population import Population, kin
from blind.visible import SEEN, visible
from lifelike import truth_of
from results import JOBS, Origin, Table, finished, share

from qlvbayes.io.data import Pad
from qlvbayes.motion.evidence import direct_evidence
from qlvbayes.motion.experiment import prepare

COLUMNS = ("population", "pads", "beyond doubt", "wrong", "95 % bound")
SHOWN = ("adhesion", "inertia", "friction", "frame_ringing", "channel_lag")
"""Effects that readings may show beyond doubt; a contact before the file's zero is one more."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pads", type=int, default=100, help="of each population")
    parser.add_argument("--seed", type=int, default=3015)
    parser.add_argument("--jobs", type=int, default=JOBS)
    options = parser.parse_args()
    origin, found = Origin.now(), {}
    for kind in ("lifelike", "wide"):
        key, run = f"evidence-{kind}-{options.seed}", partial(_case, kind, options.seed)
        found[kind] = finished(key, run, range(options.pads), options.jobs)
    rows = [_row(kind, cases) for kind, cases in found.items()]
    every = [case for cases in found.values() for case in cases]
    Table(origin, len(every), COLUMNS, rows, [shown(every), wrong(every)]).write("evidence")


def _case(kind: str, seed: int, index: int) -> Case:
    """Return what is hidden in one pad, and what its readings show beyond doubt."""
    pad, truth = _lifelike(seed, index) if kind == "lifelike" else _wide(seed, index)
    case: Case = {"plan": f"evidence-{kind}-{seed}", "index": index} | truth
    every = direct_evidence(prepare(pad), bonded=False)
    seen = [one.effect for one in every]
    return case | {"effects": [one.effect for one in every if one.beyond_doubt], "seen": seen}


def _lifelike(seed: int, index: int) -> tuple[Pad, dict]:
    study = lifelike_pads.make_study(seed, index)
    truth = truth_of(study)
    kept = {key: truth[key] for key in ("kind", "names", "kin", "rig")}
    return study.pad, kept | {"shows": [n for n, size in study.seen.items() if size >= SEEN]}


def _wide(seed: int, index: int) -> tuple[Pad, dict]:
    population = Population(seed, paper=False)
    item, study = population.item(index), wide.make_study(population, index)
    names = item.names
    truth = {
        "kind": item.levels["kind"],
        "names": list(names),
        "kin": {name: sorted(kin(name)) for name in names},
        "rig": {"gap_mm": study.rig.gap},
    }
    return study.pad, truth | {"shows": [n for n, size in visible(study).items() if size > SEEN]}


def _row(kind: str, cases: Sequence[Case]) -> list[str]:
    """Return a line of the table; the bound is of a pad with something wrong beyond doubt."""
    rate = Rate(sum(bool(_wrong(case)) for case in cases), len(cases))
    count = sum(len(case["effects"]) for case in cases)
    wrong = sum(len(_wrong(case)) for case in cases)
    return [kind, str(len(cases)), str(count), str(wrong), f"{bound(rate, good=False):.0%} of pads"]


def _wrong(case: Case) -> list[str]:
    return [name for name in case["effects"] if name not in true_names(case)]


def shown(cases: Sequence[Case]) -> str:
    """Return how many of the hidden effects of each kind are shown beyond doubt."""
    words = []
    for name in SHOWN:
        having = [case for case in cases if name in case["shows"]]
        hits = sum(name in case["effects"] for case in having)
        words += [f"{name} {share(hits, len(having))}"] if having else []
    return f"Hidden, large enough to be seen, and shown: {'; '.join(words) or 'none'}."


def wrong(cases: Sequence[Case]) -> str:
    """Return what was shown beyond doubt and is not there."""
    each = [f"{name} of pad {case['index']}" for case in cases for name in _wrong(case)]
    return f"Beyond doubt and not there: {', '.join(each) or 'nothing'}."


if __name__ == "__main__":
    main()
