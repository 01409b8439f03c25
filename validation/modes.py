"""Is the best mode of the true hypothesis found whatever the starts, and by the search?

Does another seed of starts lead the search to the same hypotheses? Writes a page.

Interrupted, it goes on where it was: finished pads lie in build/validation. `--part 0/8` to
`--part 7/8` run them in eight processes, also on several machines, and write no page.
"""

from __future__ import annotations

import argparse
import shlex
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from blind.population import Population
from blind.store import Store, code_digest
from blind.study import BlindStudy, make_study
from coverage import progress
from numpy.typing import NDArray
from page import Origin
from truth import Rig, is_modelled, truths

from qlvbayes.diagnosis.candidate import described
from qlvbayes.diagnosis.diagnose import run_search
from qlvbayes.diagnosis.search import CHECKS, Search
from qlvbayes.diagnosis.searchsetup import build_search
from qlvbayes.diagnosis.settings import Breadth
from qlvbayes.inference.forward.hypothesis import Hypothesis
from qlvbayes.io.data import Pad, read_measurements
from qlvbayes.io.files import write_whole
from qlvbayes.io.runtime import forget_compiled, one_blas_thread
from qlvbayes.motion.experiment import Experiment, prepare

Array = NDArray[np.bool_]
ROOT = Path(__file__).resolve().parents[1]
_BREADTH = Breadth()
_SAME = 0.5  # of the log density, within which two sets of starts came to one mode
_NEAR = 5.0  # log posterior behind the best, within which another seed should see the same
_OTHER = 1  # seed of the second search
_EVERY = 4  # simulated pads, of which one is searched twice

_PAGE = """# Is the same mode found whatever the starts, and by the search?

Bundled pads and pads of the wide population (`seed {seed}`: other laws, protocols and noises,
effects hidden in most). Of each the true hypothesis is asked for, laws and effects (of the bundled
pads, and where nothing of the package stands for what is hidden, the likeliest hypothesis of the
search). It was looked for from {sets} independent sets of starts, as the search does: {starts}
draws of all priors of the baseline model, then one law or effect at a time, the likeliest first,
from small and large amplitudes and several shapes; each time the relaxation was drawn anew, until
{redrawn} draws in a row led no higher. A set agrees if its best mode is within {same} of the best
of all sets and of the search in log density. The search has seen a mode if its own is. A hypothesis
that it has not looked at is missed if it is at least as probable as the search's answer. Asked for
is 99 % of both.

| | |
|---|---|
| command | `{command}` |
| date | {date} |
| commit | {commit} |
| machine | {machine} |

| pads | sets that agree | pads in which all agree | seen | not seen, less probable | missed |
|---|---|---|---|---|---|
{rows}

Checks for missed modes over all these searches: {checks}.

Twice: every search of the bundled pads, and every {every}th of the others, was made again from
another seed of starts. {twice}

{others}"""


def main() -> None:
    options = _options()
    command = shlex.join([".venv/bin/python", "validation/modes.py", *sys.argv[1:]])
    origin = Origin.now(command, ROOT)
    file = ROOT / "build" / "validation" / code_digest() / f"modes-seed{options.seed}.jsonl"
    part, parts = options.part or (0, 1)
    store = Store(file, part=None if options.part is None else part)
    bundled = _bundled()
    count = len(bundled) + options.pads
    missing = [index for index in range(part, count, parts) if index not in store.cases]
    with progress() as bar:
        for index in bar.track(missing, description="pads"):
            inside = index < len(bundled)
            some = bundled[index] if inside else _simulated(options.seed, index - len(bundled))
            if some is not None:
                name = some.name if isinstance(some, Pad) else some.pad.name
                twice = inside or (index - len(bundled)) % _EVERY == 0
                losses = _looked_for(some, options.sets, twice)
                store.add(
                    {
                        "index": index,
                        "pad": name,
                        "machine": origin.machine,
                        "commit": origin.commit,
                        **losses,
                    }
                )
                forget_compiled()
    if options.part is None:
        found = store.first(count)
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


def _simulated(seed: int, index: int) -> BlindStudy | None:
    """None where the simulator finds no balance."""
    try:
        return make_study(Population(seed), index)
    except RuntimeError as error:
        print(f"pad {index} is not made: {error}", file=sys.stderr)
        return None


def _looked_for(some: Pad | BlindStudy, sets: int, twice: bool) -> dict[str, Any]:
    """Return the losses of the hypothesis asked for, by every set and the search; inf if none.

    With them: by how much its log posterior is behind that of the search's likeliest hypothesis,
    and the search's checks for missed modes. twice: whether another seed is searched from too.
    """
    experiment = prepare(some if isinstance(some, Pad) else some.pad)
    search = build_search(experiment)
    with one_blas_thread():
        run_search(search)
        hypothesis = search.best
        if isinstance(some, BlindStudy):
            hypothesis = _true(some, experiment, search) or hypothesis
        grown = [_grown(experiment, hypothesis, seed) for seed in range(1, sets + 1)]
        own = {"twice": _twice(search, _again(experiment))} if twice else {}
    seen = [one.mode.loss for one in search.modes.get(hypothesis, [])]
    best = max([search.log_posterior(hypothesis), *(log for _, log in grown)])
    return {
        "hypothesis": described(hypothesis),
        "losses": [loss for loss, _ in grown],
        "seen": min(seen, default=float("inf")),
        "behind": search.log_posterior(search.best) - best,
        "checks": {name: vars(one) for name, one in search.checks.items()},
        **own,
    }


def _grown(experiment: Experiment, hypothesis: Hypothesis, seed: int) -> tuple[float, float]:
    """Return the lowest loss and the log posterior to which a search restricted to one way leads.

    It begins as any search does, from draws of the baseline's priors, and adds what the hypothesis
    has in addition, one law or effect at a time, the likeliest of them first.
    """
    search = build_search(experiment)
    search.seed = seed
    search.begin()
    here = search.baseline
    while here != hypothesis:
        laws = [
            replace(here, **{part: getattr(hypothesis, part)}) for part in ("elastic", "relaxation")
        ]
        steps = [*laws, *(here.plus(name) for name in hypothesis.effects - here.effects)]
        steps = [one for one in steps if one != here]
        search.expand(here, steps)
        known = [one for one in steps if one in search.modes]
        if not known:
            return float("inf"), float("-inf")
        here = max(known, key=search.log_posterior)
    return min(one.mode.loss for one in search.modes[here]), search.log_posterior(here)


def _again(experiment: Experiment) -> Search:
    """Return a whole search from another seed."""
    again = build_search(experiment)
    again.seed = _OTHER
    run_search(again)
    return again


def _twice(one: Search, two: Search) -> dict[str, Any]:
    """Hypotheses that either search has near its best, and those that both have alike.

    apart: the differences of their log posteriors; inf where the other has not seen one. errors: of
    the log evidences behind them.
    """
    searches = one, two
    best = max(search.log_posterior(search.best) for search in searches)
    near = {
        hypothesis
        for search in searches
        for hypothesis in search.modes
        if search.log_posterior(hypothesis) > best - _NEAR
    }
    apart = [one.log_posterior(h) - two.log_posterior(h) for h in near]
    return {
        "apart": [abs(value) for value in apart],
        "errors": [max(_error(search, h) for search in searches) for h in near],
        "best": described(one.best) == described(two.best),
    }


def _error(search: Search, hypothesis: Hypothesis) -> float:
    """Return the error of a log evidence; nothing where that is not known."""
    found = search.modes.get(hypothesis)
    return float(np.nan_to_num(found[0].error)) if found else 0.0


def _true(study: BlindStudy, experiment: Experiment, search: Search) -> Hypothesis | None:
    """The true hypothesis, with the rig's gap or without, which of them the search takes for more.

    None where nothing of the package stands for something that is hidden.
    """
    if not is_modelled(effect.name for effect in study.effects):
        return None
    every = truths(study.law, study.effects, Rig.of(study, experiment))
    known = [one.hypothesis for one in every]
    known = [one for one in known if one.effects <= set(search.density.space.effects)]
    return max(known, key=search.log_posterior, default=None)


def _page(found: list[dict], bundled: int, options: argparse.Namespace, origin: Origin) -> str:
    losses = [np.array([*one["losses"], one["seen"]]) for one in found]
    every = [own <= own.min() + _SAME for own in losses]
    agreeing, seen = [one[:-1] for one in every], [bool(one[-1]) for one in every]
    behind = [one["behind"] for one in found]
    rows = [
        _row(words, [(agreeing[k], seen[k], behind[k]) for k in some])
        for words, some in _groups(found, bundled, Population(options.seed)).items()
        if some
    ]
    others = [
        f"- {one['pad']} ({one['hypothesis']}): {int((~a).sum())} of {a.size} sets ended lower"
        + ("" if is_seen else _unseen(one, float(own[-1] - own.min())))
        for one, own, a, is_seen in zip(found, losses, agreeing, seen, strict=True)
        if not (a.all() and is_seen)
    ]
    listed = "Pads in which some set or the search ended elsewhere:\n\n" + "\n".join(others) + "\n"
    return _PAGE.format(
        seed=options.seed,
        sets=options.sets,
        starts=_BREADTH.starts,
        redrawn=_BREADTH.draws,
        same=_SAME,
        rows="\n".join(rows),
        checks=_counted(found),
        twice=_agreeing(found),
        every=_EVERY,
        others=listed if others else "Nothing ended elsewhere.\n",
        command=origin.command,
        date=origin.date,
        commit=", ".join(dict.fromkeys(one["commit"] for one in found)),
        machine="; ".join(sorted({one["machine"] for one in found})),
    )


def _groups(found: list[dict], bundled: int, population: Population) -> dict[str, list[int]]:
    """Indices of the bundled pads, and of the simulated ones without an outsider and with one."""
    groups: dict[str, list[int]] = {
        "bundled": list(range(min(bundled, len(found)))),
        "simulated, the true hypothesis": [],
        "simulated with an outsider, the likeliest hypothesis": [],
    }
    _, true, likeliest = groups.values()
    for k in range(bundled, len(found)):
        names = population.item(found[k]["index"] - bundled).names
        (true if is_modelled(names) else likeliest).append(k)
    return groups


def _row(words: str, pads: list[tuple[Array, bool, float]]) -> str:
    """A row of the table: of each pad which sets agree, whether it was seen, and how far behind."""
    sets, agree = sum(a.size for a, _, _ in pads), sum(int(a.sum()) for a, _, _ in pads)
    known = sum(seen for _, seen, _ in pads)
    shares = [f"{k} of {n} ({k / n:.1%})" for k, n in ((agree, sets), (known, len(pads)))]
    unseen = [behind for _, seen, behind in pads if not seen]
    less = sum(behind > _SAME for behind in unseen)
    whole = sum(bool(a.all()) for a, _, _ in pads)
    return (
        f"| {len(pads)} {words} | {shares[0]} | {whole} | {shares[1]} | {less} "
        f"| {len(unseen) - less} |"
    )


def _unseen(one: dict[str, Any], lower: float) -> str:
    """Return what is said of a hypothesis whose best mode the search has not seen."""
    if np.isfinite(lower):
        return f"; the search's own mode is {lower:.1f} lower"
    return f"; the search, whose answer is {one['behind']:.1f} more probable, has not looked at it"


def _counted(found: list[dict]) -> str:
    """Return how often each check was made, failed, and led to a likelier mode."""
    said = []
    for name in CHECKS:
        made, failed, higher = (
            sum(one["checks"][name][key] for one in found) for key in ("made", "failed", "higher")
        )
        said.append(f"{name} made {made} times, failed {failed}, led to a likelier mode {higher}")
    return "; ".join(said)


def _agreeing(found: list[dict]) -> str:
    """In how many pads, and in how many of the hypotheses that count, two seeds agree."""
    repeated = [one["twice"] for one in found if "twice" in one]
    apart = np.array([value for one in repeated for value in one["apart"]])
    errors = np.array([value for one in repeated for value in one["errors"]])
    alike = apart <= np.maximum(_SAME, 3.0 * errors)
    same = sum(one["best"] for one in repeated)
    return (
        f"Of {len(repeated)} pads {same} have the same likeliest hypothesis; of {apart.size} "
        f"hypotheses within {_NEAR:g} of the best log posterior of either search "
        f"{int(alike.sum())} have the same one in both (to {_SAME:g}, or to three of its errors), "
        f"and {int(np.isinf(apart).sum())} were seen by one of the two only."
    )


if __name__ == "__main__":
    main()
